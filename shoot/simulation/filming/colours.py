"""Colours of filmed drives, beside those of all pictures (`shoot.rendering.palette`)."""

from typing import Final

# Ground: pale, so that costs can darken it and paths stand out.
LAWN: Final = "#f0ece1"
PAVEMENT: Final = "#e2ddd2"
ROAD: Final = "#dbe0e5"
PAINT: Final = "#ffffff"
CENTRE_PAINT: Final = "#e8c86a"
CROSSWALK: Final = "#f4f6f8"
HOUSE: Final = "#cbc3b5"
TREE: Final = "#c3d2b8"
PROP: Final = "#b5aea2"
PARKED: Final = "#a3acb6"
ROUTE: Final = "#009e73"  # Okabe-Ito green
# Who moves.
VEHICLE: Final = "#3f93c8"
PERSON: Final = "#a84c86"
BRAKING: Final = "#d7263d"
WRONG: Final = "#c1121f"
# Lights by what they show: red, amber, green; their bars differ in width, too.
LIGHTS: Final = ("#d7263d", "#e69f00", "#009e73")
