"""The page of a scene as one file: data, script, style and markup, and nothing to be fetched."""

import base64
import hashlib
import json
from dataclasses import asdict
from importlib import resources
from pathlib import Path

import numpy as np
from matplotlib.colors import to_hex

from lss_core.files import write_atomically
from shoot.rendering import palette
from shoot.report.html.document import POLICY, document
from shoot.report.html.markup import Html, element, join
from shoot.report.viewer.scene import ViewedScene

_NUM_COLOURS = 16


def write_viewer(scene: ViewedScene, path: str | Path) -> int:
    """Write the page, whole or not at all; returns its bytes. See `render_viewer`."""
    page = render_viewer(scene).encode()
    with write_atomically(path) as stream:
        stream.write(page)
    return len(page)


def render_viewer(scene: ViewedScene) -> str:
    """The page as text; the same scene gives the same text.

    The browser may run this page's own script only, and fetch nothing. Texts of the data stand in
    the page as JSON, which the script writes as text: none can become markup.
    """
    script = _asset("drawing.js") + _asset("viewer.js")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    colours = palette.PROBABILITY(np.linspace(0.0, 1.0, _NUM_COLOURS))
    data = asdict(scene) | {"colours": [to_hex(colour) for colour in colours]}
    body = join(
        Html(_asset("viewer.html")),
        element("script", _json(data), type="application/json", id="scene"),
        element("script", Html(script), type="module"),
    )
    style = f"{_colours()}\n{_asset('viewer.css')}"
    return document(scene.name, body, style, f"{POLICY}; script-src 'sha256-{digest}'")


def _json(data: object) -> Html:
    """Data that cannot end the element that it stands in."""
    return Html(json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"))


def _colours() -> str:
    """Of the palette, as the style names them."""
    ramp = ",".join(to_hex(colour) for colour in palette.COST(np.linspace(0.0, 1.0, 5)))
    return (
        f":root{{--planned:{palette.PLANNED};--driven:{palette.DRIVEN};--off:{palette.OFF_MAP};"
        f"--ramp:{ramp}}}"
    )


def _asset(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")
