"""Which categories of boxes are vehicles or people, in the words of several data sets.

nuScenes' names begin with the kind, as `vehicle.car`. Lyft Level 5, Argoverse 2, KITTI and Waymo
name the kind alone, each with words of its own. Letter case, spaces and hyphens do not matter.
"""

_COUNTED = frozenset(
    {
        # nuScenes before the first dot, and its detection task.
        *("vehicle", "human", "construction_vehicle", "trailer"),
        # Lyft Level 5.
        *("car", "truck", "bus", "motorcycle", "bicycle", "pedestrian"),
        *("other_vehicle", "emergency_vehicle"),
        # Argoverse 2.
        *("regular_vehicle", "large_vehicle", "railed_vehicle", "box_truck", "truck_cab"),
        *("school_bus", "articulated_bus", "vehicular_trailer", "message_board_trailer"),
        *("traffic_light_trailer", "motorcyclist", "bicyclist", "wheeled_device"),
        *("wheeled_rider", "stroller", "wheelchair", "official_signaler"),
        # KITTI, Waymo.
        *("van", "tram", "cyclist", "person", "person_sitting"),
    }
)
# Barriers, cones and debris stand at the edge of the road or on it, and may be driven through;
# animals and bicycle racks are few.
_PASSED_OVER = frozenset(
    {
        # nuScenes before the first dot, and its detection task.
        *("movable_object", "static_object", "animal", "flat", "noise", "barrier", "traffic_cone"),
        # Argoverse 2.
        *("dog", "bollard", "construction_barrel", "construction_cone", "sign", "stop_sign"),
        *("mobile_pedestrian_crossing_sign", "mobile_pedestrian_sign"),
        # KITTI.
        *("misc", "dontcare"),
    }
)


def is_road_user(category: str) -> bool | None:
    """Whether a category is of vehicles or people; None if nobody knows the name."""
    kind = plain_name(category).split(".")[0]
    if kind in _COUNTED:
        return True
    return False if kind in _PASSED_OVER else None


def plain_name(category: str) -> str:
    """A category's name in small letters, its words joined by underscores, as `vehicle.car`."""
    words = "_".join(category.strip().lower().replace("-", " ").replace("_", " ").split())
    return words.removeprefix("type_")
