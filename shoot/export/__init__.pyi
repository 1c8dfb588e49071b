from .card import make_card as make_card
from .graph import PlannerGraph as PlannerGraph
from .numpy_inputs import Crop as Crop
from .numpy_inputs import choose_crop as choose_crop
from .numpy_inputs import make_splat_index as make_splat_index
from .onnx_file import write_onnx as write_onnx
from .program import write_program as write_program

__all__ = [
    "Crop",
    "PlannerGraph",
    "choose_crop",
    "make_card",
    "make_splat_index",
    "write_onnx",
    "write_program",
]
