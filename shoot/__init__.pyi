from .planner import Planner as Planner
from .planner import score_templates as score_templates
from .prediction import FastPlanner as FastPlanner
from .prediction import open_run as open_run
from .templates import TemplateSet as TemplateSet
from .templates import fit_templates as fit_templates

__version__: str

__all__ = ["FastPlanner", "Planner", "TemplateSet", "fit_templates", "open_run", "score_templates"]
