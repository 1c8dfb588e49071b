from .fitting import fit_templates as fit_templates
from .fitting import fit_templates_stream as fit_templates_stream
from .template_set import Coverage as Coverage
from .template_set import TemplateSet as TemplateSet
from .vocabulary import read_vocabulary as read_vocabulary
from .vocabulary import write_vocabulary as write_vocabulary

__all__ = [
    "Coverage",
    "TemplateSet",
    "fit_templates",
    "fit_templates_stream",
    "read_vocabulary",
    "write_vocabulary",
]
