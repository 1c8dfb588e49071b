"""A matplotlib figure as SVG that can stand inside a page beside others."""

import io
import re
from xml.etree import ElementTree

import matplotlib as mpl
from matplotlib.figure import Figure

from lss_core.legible import legible
from shoot.report.html.markup import Html

_REFERENCE = re.compile(r"url\(#([^)]+)\)")
_PX_PER_PT = 96.0 / 72.0


def inline_svg(figure: Figure, name: str, alt: str) -> Html:
    """A figure as an `<svg>` element, the same bytes for the same figure.

    Texts stay texts (in the font of the page), ids are made unique by the figure's name, and style
    sheets are left out, since those of one figure would style the whole page.

    Args:
        figure: To be drawn; its size in inches times 96 is its size in pixels.
        name: Unlike that of every other figure of the page; letters and digits.
        alt: What it shows, for those who cannot see it.
    """
    stream = io.BytesIO()
    unstamped = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": name}):
        figure.savefig(stream, format="svg", metadata=unstamped)
    root = ElementTree.fromstring(stream.getvalue())
    for parent in list(root.iter()):
        for child in list(parent):
            if _local(child.tag) in ("metadata", "style"):
                parent.remove(child)
    used = {
        reference
        for node in root.iter()
        for key, value in node.attrib.items()
        for reference in (
            [value.removeprefix("#")] if _local(key) == "href" else _REFERENCE.findall(value)
        )
    }
    for node in root.iter():
        node.tag = _local(node.tag)
        node.attrib = {
            _local(key): _renamed(_local(key), value, name)
            for key, value in node.attrib.items()
            if key != "id" or value in used
        }
        node.tail = None
        if node.text is not None and not node.text.strip():
            node.text = None
    width_px, height_px = (
        float(root.attrib[side].removesuffix("pt")) * _PX_PER_PT for side in ("width", "height")
    )
    root.attrib = {
        "viewBox": root.attrib["viewBox"],
        "width": f"{width_px:.0f}",
        "height": f"{height_px:.0f}",
        "role": "img",
        "aria-label": legible(alt),
    }
    return Html(ElementTree.tostring(root, encoding="unicode"))


def _local(name: str) -> str:
    """A name without its namespace: in HTML `<svg>` needs none."""
    return name.rpartition("}")[2]


def _renamed(key: str, value: str, name: str) -> str:
    if key == "id":
        return f"{name}-{value}"
    if key == "href":
        return f"#{name}-{value.removeprefix('#')}"
    return _REFERENCE.sub(rf"url(#{name}-\1)", value)
