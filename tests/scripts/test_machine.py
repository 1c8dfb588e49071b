"""A time says on which units it was measured."""

import importlib
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "scripts")
    return importlib.import_module("benchmarks.machine")


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        ("fpu avx avx2", "AVX2"),
        ("fpu avx2 avx512f", "AVX-512"),
        ("avx2 avx512f avx512_bf16", "AVX-512, bfloat16 products"),
        (
            "avx2 avx512f avx512_bf16 amx_bf16",
            "AVX-512, bfloat16 products, bfloat16 matrix units",
        ),
        ("asimd", "units not known"),
    ],
)
def test_units_by_the_processors_flags(machine: Any, flags: str, expected: str) -> None:
    assert machine.processor_units(flags.split(), {}) == expected


def test_what_the_environment_forbids_is_said(machine: Any) -> None:
    held = {"ONEDNN_MAX_CPU_ISA": "AVX2", "ATEN_CPU_CAPABILITY": "avx2", "HOME": "/"}
    said = machine.processor_units(["avx2", "avx512f"], held)
    assert said == "AVX-512, held to ONEDNN_MAX_CPU_ISA=AVX2 ATEN_CPU_CAPABILITY=avx2"
