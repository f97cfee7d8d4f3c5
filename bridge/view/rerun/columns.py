"""Collectors that send a log's values to Rerun in columns.

Columns are a thousand times faster than rows. A collector discards the values that it has sent, so
it also works for a live run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from bridge.view.rerun import paths

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

_NANOSECONDS = 1e9


class RerunRecording:
    """A Rerun recording and the start time of its run."""

    def __init__(self, stream: rr.RecordingStream, start_ns: int) -> None:
        self.stream = stream
        self.start_ns = start_ns
        self._styled: set[str] = set()

    def send(self, entity: str, times_ns: list[int], columns: Iterable[rr.ComponentColumn]) -> None:
        """Send columns whose rows have these times (Unix time, ns)."""
        times: NDArray[np.int64] = np.asarray(times_ns, dtype=np.int64)
        self.stream.send_columns(
            entity,
            [
                rr.TimeColumn(
                    paths.TIMELINE, duration=(times - self.start_ns).astype("timedelta64[ns]")
                ),
                rr.TimeColumn(paths.UNIX_TIMELINE, timestamp=times.astype("datetime64[ns]")),
            ],
            columns,
        )

    def send_strips(
        self,
        entity: str,
        times_ns: list[int],
        strips: NDArray[np.float32] | list[NDArray[np.float32]],
        colour: paths.Colour,
        width: float,
    ) -> None:
        """Send line strips. Each strip becomes visible at its time; the width is in points."""
        radii = rr.Radius.ui_points(width)
        self.style(entity, rr.LineStrips3D.from_fields(colors=colour, radii=radii))
        self.send(entity, times_ns, rr.LineStrips3D.columns(strips=strips))

    def log_static(self, entity: str, *parts: rr.AsComponents) -> None:
        """Log data that is valid for the whole run."""
        self.stream.log(entity, *parts, static=True)

    def style(self, entity: str, *parts: rr.AsComponents) -> None:
        """Log the style of an entity, once."""
        if entity not in self._styled:
            self._styled.add(entity)
            self.log_static(entity, *parts)

    def seconds(self, time_ns: int) -> float:
        """Return the time since the start of the run, s."""
        return (time_ns - self.start_ns) / _NANOSECONDS


class Series:
    """Curves of one plot with common times; NaN is a gap."""

    def __init__(self, entity: str, **curves: paths.Colour) -> None:
        self._entity = entity
        self._curves = curves
        self._times: list[int] = []
        self._values: list[tuple[float, ...]] = []

    def add(self, time_ns: int, *values: float | None) -> None:
        """Add one value for each curve, in order; None is a gap."""
        row = tuple(np.nan if v is None else float(v) for v in values)
        self._times.append(time_ns)
        self._values.append(row)

    def send(self, recording: RerunRecording) -> None:
        """Send the collected values, if any."""
        if not self._times:
            return
        values = np.array(self._values, dtype=np.float64)
        for index, (name, colour) in enumerate(self._curves.items()):
            entity = f"{self._entity}/{name}"
            label = name.replace("_", " ")
            recording.style(entity, rr.SeriesLines(colors=colour, names=label, widths=1.5))
            recording.send(entity, self._times, rr.Scalars.columns(scalars=values[:, index]))
        self._times, self._values = [], []


class States:
    """A named state that changes over time."""

    def __init__(self, entity: str) -> None:
        self._entity = entity
        self._times: list[int] = []
        self._states: list[str] = []
        self._last: str | None = None

    def add(self, time_ns: int, state: str) -> None:
        """Add the state if it differs from the previous state."""
        if self._last != state:
            self._last = state
            self._times.append(time_ns)
            self._states.append(state)

    def send(self, recording: RerunRecording) -> None:
        """Send the collected values, if any."""
        if self._times:
            recording.send(self._entity, self._times, rr.StateChange.columns(state=self._states))
            self._times, self._states = [], []


class TextLines:
    """Lines of text with their severity."""

    def __init__(self, entity: str) -> None:
        self._entity = entity
        self._times: list[int] = []
        self._lines: list[str] = []
        self._levels: list[rr.components.TextLogLevel] = []

    def add(self, time_ns: int, level: str, line: str) -> None:
        """Add one line."""
        self._times.append(time_ns)
        self._lines.append(line)
        self._levels.append(_LEVELS.get(level, rr.TextLogLevel.INFO))

    def send(self, recording: RerunRecording) -> None:
        """Send the collected values, if any."""
        if self._times:
            columns = rr.TextLog.columns(text=self._lines, level=self._levels)
            recording.send(self._entity, self._times, columns)
            self._times, self._lines, self._levels = [], [], []


class Document:
    """A Markdown text that changes over time."""

    def __init__(self, entity: str) -> None:
        self._entity = entity
        self._times: list[int] = []
        self._texts: list[str] = []

    def add(self, time_ns: int, text: str) -> None:
        """Add a text that is shown from this time on."""
        self._times.append(time_ns)
        self._texts.append(text)

    def send(self, recording: RerunRecording) -> None:
        """Send the collected values, if any."""
        if self._times:
            recording.style(
                self._entity, rr.TextDocument.from_fields(media_type=rr.MediaType.MARKDOWN)
            )
            columns = rr.TextDocument.columns(text=self._texts)
            recording.send(self._entity, self._times, columns)
            self._times, self._texts = [], []


_LEVELS = {
    "debug": rr.TextLogLevel.DEBUG,
    "info": rr.TextLogLevel.INFO,
    "warning": rr.TextLogLevel.WARN,
    "error": rr.TextLogLevel.ERROR,
}
