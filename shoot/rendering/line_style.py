"""How the driven path looks, in every panel and in the legend."""

from typing import Any

from matplotlib.patheffects import Normal, Stroke

from shoot.rendering import palette


def driven_style(line_width: float) -> dict[str, Any]:
    """Line style of the driven path everywhere: blue, dashed, on a white casing."""
    return {
        "color": palette.DRIVEN,
        "linewidth": line_width,
        "linestyle": (0, (2.4, 1.2)),
        "path_effects": [
            _SolidCasing(linewidth=line_width + 1.8, foreground="white"),
            Normal(),
        ],
        "dash_capstyle": "butt",
    }


class _SolidCasing(Stroke):
    """A casing that does not share the dashes of the line it surrounds."""

    def draw_path(
        self,
        renderer: Any,
        gc: Any,
        tpath: Any,
        affine: Any,
        rgbFace: Any = None,  # noqa: N803
    ) -> None:
        """Draw the line once, undashed."""
        undashed = renderer.new_gc()
        undashed.copy_properties(gc)
        undashed.set_dashes(0, None)
        super().draw_path(renderer, undashed, tpath, affine, rgbFace)
