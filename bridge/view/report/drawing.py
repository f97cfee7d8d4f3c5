"""Matplotlib figures without a display: creation, output as SVG or PNG, and common style."""

from __future__ import annotations

import io
import os
from typing import TYPE_CHECKING

from bridge.errors import BridgeError

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MAX_LETTERS = 1000
"""Maximum length of a text in a figure, characters. The layout of 100 000 characters takes a
minute."""
_DPI = 110


class PlotMissingError(BridgeError):
    """matplotlib is not installed."""

    def __init__(self) -> None:
        super().__init__("pictures need matplotlib: pip install 'sweepctl[plot]'")


def blank(width: float, height: float) -> Figure:
    """Return an empty figure of this size, inches.

    Raises:
        PlotMissingError: matplotlib is not installed.

    """
    chosen = os.environ.pop("MPLBACKEND", None)  # a display's; a wrong one fails the import
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415 - an extra
        from matplotlib.figure import Figure  # noqa: PLC0415 - an extra
    except ImportError:
        raise PlotMissingError from None
    finally:
        if chosen is not None:
            os.environ["MPLBACKEND"] = chosen
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def svg(width: float, height: float, draw: Callable[[Axes], None]) -> str:
    """Draw one figure and return it as SVG. Equal data give equal text."""
    figure = blank(width, height)
    draw(figure.add_subplot())
    return as_svg(figure)


def as_svg(figure: Figure) -> str:
    """Return a figure as SVG for a page. Equal data give equal text."""
    import matplotlib as mpl  # noqa: PLC0415 - an optional dependency, imported where it is used

    out = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "sweepctl", "svg.fonttype": "path"}):
        figure.savefig(out, format="svg", metadata={"Date": None})
    text = out.getvalue()
    return text[text.index("<svg") :]


def as_png(figure: Figure, dpi: float = _DPI) -> bytes:
    """Return a figure as a PNG."""
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=dpi)
    return out.getvalue()


def tidy(axes: Axes) -> None:
    """Apply the common style: a light grid and no frame."""
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)


def floor_axes(axes: Axes) -> None:
    """Set up axes for a floor plan: metres, with equal scale."""
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")


def nothing(axes: Axes, why: str) -> None:
    """Write the reason for the missing figure into the axes."""
    axes.text(0.5, 0.5, why, ha="center", transform=axes.transAxes)
    axes.set_axis_off()


def drawn_text(text: str) -> str:
    """Return a text that matplotlib draws literally: valid UTF-8, with no TeX formulas."""
    if len(text) > _MAX_LETTERS:
        text = text[:_MAX_LETTERS] + "…"
    return text.encode("utf-8", "replace").decode().replace("$", r"\$")
