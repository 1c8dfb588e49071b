from .collisions import Contact as Contact
from .score import DrivingScore as DrivingScore
from .score import epdms as epdms
from .surroundings import Lanes as Lanes
from .surroundings import Lights as Lights
from .surroundings import Surroundings as Surroundings
from .tracks import Others as Others
from .tracks import Track as Track
from .tracks import no_others as no_others
from .tracks import track_of_plan as track_of_plan

__all__ = [
    "Contact",
    "DrivingScore",
    "Lanes",
    "Lights",
    "Others",
    "Surroundings",
    "Track",
    "epdms",
    "no_others",
    "track_of_plan",
]
