"""Templates: the K trajectories a planner chooses from, where they come from, where they go."""

from shoot.templates.fitting import fit_templates, fit_templates_stream
from shoot.templates.template_set import Coverage, TemplateSet
from shoot.templates.vocabulary import read_vocabulary, write_vocabulary

__all__ = [
    "Coverage",
    "TemplateSet",
    "fit_templates",
    "fit_templates_stream",
    "read_vocabulary",
    "write_vocabulary",
]
