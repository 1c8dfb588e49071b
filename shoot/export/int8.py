"""Convolutions of an ONNX planner in int8, and what that costs in agreement."""

import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lss_core.files import write_atomically
from shoot.export.onnx_file import import_onnx

# What a file is run on: its inputs by name.
Inputs = Mapping[str, NDArray[Any]]
_TOP = 10


@dataclass(frozen=True)
class Agreement:
    """How far two files say the same of some samples.

    Attributes:
        num_samples: How many.
        top10: Share of the ten most probable templates that are the same, 0 to 1.
        largest_change: Of any probability.
    """

    num_samples: int
    top10: float
    largest_change: float

    @property
    def sentence(self) -> str:
        """In words."""
        return (
            f"On {self.num_samples} validation samples {100 * self.top10:.1f} % of the ten most "
            "probable templates are those of float32, and a probability changes by at most "
            f"{self.largest_change:.4f}."
        )


def quantise(source: Path, target: Path, samples: Iterable[Inputs]) -> None:
    """Write a file whose convolutions run in int8; scales are of what the samples bring about.

    Weights have a scale for each channel. Splat and reads stay in float32, as do the layers that
    `_kept_in_float` names.

    Args:
        source: The file in float32.
        target: The file to write, whole or not at all.
        samples: To calibrate with.

    Raises:
        DataError: If packages are missing.
        OSError: If it cannot be written.
    """
    onnx = import_onnx()
    from onnxruntime import quantization
    from onnxruntime.quantization.shape_inference import quant_pre_process

    class Reader(quantization.CalibrationDataReader):  # type: ignore[misc]
        """Hands out one sample after the other."""

        def __init__(self) -> None:
            self._samples: Iterator[Inputs] = iter(samples)

        def get_next(self) -> Inputs | None:
            return next(self._samples, None)

    with tempfile.TemporaryDirectory() as folder:
        prepared, result = Path(folder) / "prepared.onnx", Path(folder) / "int8.onnx"
        quant_pre_process(source, prepared, skip_optimization=True, skip_symbolic_shape=True)
        quantization.quantize_static(
            prepared,
            result,
            Reader(),
            quant_format=quantization.QuantFormat.QDQ,
            op_types_to_quantize=["Conv"],
            nodes_to_exclude=_kept_in_float(onnx.load(prepared)),
            per_channel=True,
            activation_type=quantization.QuantType.QInt8,
            weight_type=quantization.QuantType.QInt8,
        )
        onnx.checker.check_model(onnx.load(result), full_check=True)
        with write_atomically(target) as stream:
            stream.write(result.read_bytes())


def _kept_in_float(model: Any) -> list[str]:
    """The last convolution, of little work: its costs are summed over a whole template."""
    return [[node.name for node in model.graph.node if node.op_type == "Conv"][-1]]


def compare_files(one: Path, other: Path, samples: Sequence[Inputs]) -> Agreement:
    """How far two files agree, in onnxruntime on this machine's CPU."""
    first, second = (run_file(file, samples) for file in (one, other))
    tops = [np.argsort(-prob, axis=-1, kind="stable")[:, :_TOP] for prob in (first, second)]
    same = [len(set(a) & set(b)) / len(a) for a, b in zip(*tops, strict=True)]
    return Agreement(len(samples), float(np.mean(same)), float(np.abs(first - second).max()))


def run_file(file: Path, samples: Iterable[Inputs]) -> NDArray[np.float32]:
    """[S, K] probabilities by onnxruntime on this machine's CPU.

    Raises:
        DataError: If packages are missing.
    """
    session = open_session(file)
    prob: NDArray[np.float32] = np.concatenate(
        [session.run(["probabilities"], inputs)[0] for inputs in samples]
    )
    return prob


def open_session(file: Path) -> Any:
    """A session of onnxruntime on this machine's CPU.

    Raises:
        DataError: If packages are missing.
    """
    import_onnx()
    import onnxruntime

    return onnxruntime.InferenceSession(file, providers=["CPUExecutionProvider"])
