"""Figures as matplotlib makes them, for no display: blank sheets, their bytes, a common look."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from bridge.errors import BridgeError

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MAX_LETTERS = 1000
"""Longest text in a figure, letters: laying out a hundred thousand takes a minute."""
_DPI = 110


class PlotMissingError(BridgeError):
    """matplotlib is not installed."""

    def __init__(self) -> None:
        super().__init__("pictures need matplotlib: pip install 'sweepctl[plot]'")


def blank(width: float, height: float) -> Figure:
    """A figure of this size in inches.

    Raises:
        PlotMissingError: matplotlib is not installed.

    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415 - an extra
        from matplotlib.figure import Figure  # noqa: PLC0415 - an extra
    except ImportError:
        raise PlotMissingError from None
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def svg(width: float, height: float, draw: Callable[[Axes], None]) -> str:
    """One figure as SVG text, the same text for the same data."""
    figure = blank(width, height)
    draw(figure.add_subplot())
    return as_svg(figure)


def as_svg(figure: Figure) -> str:
    """A figure as SVG text, to stand within a page; the same text for the same data."""
    import matplotlib as mpl  # noqa: PLC0415 - an extra

    out = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "sweepctl", "svg.fonttype": "path"}):
        figure.savefig(out, format="svg", metadata={"Date": None})
    text = out.getvalue()
    return text[text.index("<svg") :]


def as_png(figure: Figure, dpi: float = _DPI) -> bytes:
    """A figure as a PNG."""
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=dpi)
    return out.getvalue()


def tidy(axes: Axes) -> None:
    """A light grid and no frame."""
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)


def floor_axes(axes: Axes) -> None:
    """Axes of a room's floor: metres, of the same length both ways."""
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")


def nothing(axes: Axes, why: str) -> None:
    """Say why there is no figure."""
    axes.text(0.5, 0.5, why, ha="center", transform=axes.transAxes)
    axes.set_axis_off()


def drawn_text(text: str) -> str:
    """Others' words, as a figure takes them: no mathematics between dollars, no half letters."""
    if len(text) > _MAX_LETTERS:
        text = text[:_MAX_LETTERS] + "…"
    return text.encode("utf-8", "replace").decode().replace("$", r"\$")
