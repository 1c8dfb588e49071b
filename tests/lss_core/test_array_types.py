"""Shapes of arrays are written so that the newest numpy can be told them."""

import subprocess
import sys
import textwrap

import pytest


@pytest.mark.full
def test_modules_are_imported_where_ndarray_is_a_type_alias() -> None:
    # As numpy 2.5 has it. jaxtyping takes classes, and their generics: `np.ndarray[...]`.
    code = """
        import importlib, pkgutil
        from typing import Any, TypeVar

        import numpy as np
        import numpy.typing as npt
        from typing_extensions import TypeAliasType

        # Libraries come first: what they make of it is theirs.
        import embreex, joblib, matplotlib.pyplot, nuscenes, pytorch_lightning, scipy.optimize
        import shapely, sklearn.cluster, timm, torchmetrics, torchvision, tyro

        Scalar = TypeVar("Scalar", bound=np.generic)
        array = np.ndarray[tuple[Any, ...], np.dtype[Scalar]]
        npt.NDArray = TypeAliasType("NDArray", array, type_params=(Scalar,))

        import lss_core, shoot

        for package in (lss_core, shoot):
            for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
                importlib.import_module(module.name)
                print(module.name)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert {
        "shoot.metrics.ranks",
        "shoot.rendering.sample_view",
        "lss_core.data.sensors.lidar",
    } <= set(done.stdout.split())
