from .drivers.driver import Driver as Driver
from .drivers.driver import drive as drive
from .observation import Observation as Observation
from .plan import Plan as Plan
from .route_log import RouteLog as RouteLog
from .senses import SensorSettings as SensorSettings
from .simulator import Simulator as Simulator

__all__ = ["Driver", "Observation", "Plan", "RouteLog", "SensorSettings", "Simulator", "drive"]
