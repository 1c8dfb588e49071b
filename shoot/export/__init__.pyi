from .graph import PlannerGraph as PlannerGraph

__all__ = ["PlannerGraph"]
