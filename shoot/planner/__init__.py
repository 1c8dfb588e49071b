"""The paper's section 3.3: costs read along templates, and what training asks of them."""

from shoot.planner.margin import max_margin_loss
from shoot.planner.planner import Planner, PlannerConfig
from shoot.planner.reads import (
    Interpolation,
    OffGrid,
    TemplateReads,
    prepare_reads,
    read_waypoints,
    share_on_grid,
)
from shoot.planner.scores import score_reads, score_templates

__all__ = [
    "Interpolation",
    "OffGrid",
    "Planner",
    "PlannerConfig",
    "TemplateReads",
    "max_margin_loss",
    "prepare_reads",
    "read_waypoints",
    "score_reads",
    "score_templates",
    "share_on_grid",
]
