"""The example that is shipped is what its script draws."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from scripts.ship_example import draw_example
from shoot.moment.example import SPEED_MPS

SHIPPED = Path(__file__).parents[2] / "templates" / "example-rig"


@pytest.mark.full
def test_shipped_as_drawn(tmp_path: Path) -> None:
    assert draw_example(tmp_path) == pytest.approx(SPEED_MPS, abs=0.05)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == sorted(path.name for path in SHIPPED.iterdir())
    assert (tmp_path / "rig.yaml").read_bytes() == (SHIPPED / "rig.yaml").read_bytes()
    for name in names[:-1]:
        # Other releases of OpenCV may draw other bytes.
        drawn, shipped = (np.asarray(Image.open(f / name), float) for f in (tmp_path, SHIPPED))
        assert np.abs(drawn - shipped).mean() < 1.0
