"""Output of ``sweepctl monitor``: lines, JSON, or a table that is redrawn."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Self

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table as RichTable
from rich.text import Text

from tools.cli.console import drop_queued, flush, inform, plain_console, write_json, write_line

if TYPE_CHECKING:
    from types import TracebackType

    from bridge.session.monitor import Monitor, Seen
    from protocol.clock import HostNs

_REDRAW_NS = 250_000_000
"""Period at which a table is redrawn, ns."""
_RATES_NS = 1_000_000_000
"""Period at which rates are printed, ns."""
_SHOWN_BYTES = 32
"""Maximum number of damaged bytes shown in the table."""
_SILENCE = "rates (Hz): no messages"


class Nothing:
    """Base class of the views; shows nothing."""

    def show(self, seen: Seen) -> None:
        """Show one message or piece of damaged data."""

    def tick(self, monitor: Monitor, now_ns: HostNs) -> None:
        """Update rates and time; called at least ten times a second."""

    def sum_up(self, monitor: Monitor) -> None:
        """Print the totals at the end."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Restore the terminal."""


class MonitorLines(Nothing):
    """A line for each message on stdout, and the rates once a second on stderr."""

    def __init__(self, *, raw: bool) -> None:
        """Create the view; with ``raw``, payloads are printed in hex too."""
        self._raw = raw
        self._rates_ns = 0
        self._start_ns: int | None = None
        self._warned: set[int] = set()
        self._reported_silence = ""
        """The printed line about a silence; empty while messages arrive."""

    def show(self, seen: Seen) -> None:
        """Print a line."""
        if self._start_ns is None:
            self._start_ns = seen.host_ns
        since_s = (seen.host_ns - self._start_ns) / 1e9
        if seen.kind == "message":
            stamp_s = seen.t_us / 1e6
            arrow = ">" if seen.direction == "host" else "<"
            line = f"{since_s:9.3f} {arrow} {seen.node:2d} {stamp_s:12.6f} {seen.name} {seen.text}"
            if self._raw:
                line += f"  [{seen.raw.hex(' ')}]"
        else:
            line = f"{since_s:9.3f} ! {seen.kind}: {seen.text}: {seen.raw.hex(' ')}"
        write_line(line)

    def tick(self, monitor: Monitor, now_ns: HostNs) -> None:
        """Flush stdout, and print the rates once a second."""
        flush()
        for node, value in monitor.foreign_catalogues.items():
            if node not in self._warned:
                self._warned.add(node)
                inform(_stranger(node, value))
        if now_ns - self._rates_ns >= _RATES_NS:
            rates = _rates(monitor)
            # A silence is reported only once.
            if self._rates_ns and rates != self._reported_silence:
                inform(rates)
                self._reported_silence = rates if rates.startswith(_SILENCE) else ""
            self._rates_ns = now_ns

    def sum_up(self, monitor: Monitor) -> None:
        """Print the totals."""
        inform(_totals(monitor))


class JsonLines(Nothing):
    """A JSON object for each message on stdout."""

    def __init__(self, *, raw: bool) -> None:
        """Create the view; with ``raw``, objects contain the payload in hex."""
        self._raw = raw

    def show(self, seen: Seen) -> None:
        """Print an object."""
        found = {
            "host_s": seen.host_ns / 1e9,
            "kind": seen.kind,
            "name": seen.name,
            "node": seen.node,
            "from": seen.direction or None,
            "t_us": seen.t_us,
            "fields": seen.fields,
        }
        if self._raw or seen.kind != "message":
            found["raw"] = seen.raw.hex()
        write_json(found)

    def tick(self, monitor: Monitor, now_ns: HostNs) -> None:  # noqa: ARG002 - the base's interface
        """Flush stdout."""
        flush()

    def sum_up(self, monitor: Monitor) -> None:
        """Print the totals."""
        inform(_totals(monitor))


class RateTable(Nothing):
    """A table of each type's rate and newest content, and the newest damaged bytes."""

    def __init__(self, monitor: Monitor, port: str, types: tuple[str, ...]) -> None:
        """Prepare the table; ``__enter__`` draws it."""
        self._monitor, self._port, self._types = monitor, port, types
        self._drawn_ns = 0
        self._console = plain_console()
        self._live = Live(
            self.picture(self._console), console=self._console, auto_refresh=False, screen=False
        )

    def picture(self, console: Console) -> Group:
        """Return the table; in a low window each type has one line, cut at its end."""
        whole = self._picture(is_low=False)
        if len(console.render_lines(whole)) <= console.height:
            return whole
        return self._picture(is_low=True)

    def _picture(self, *, is_low: bool) -> Group:
        monitor = self._monitor
        title = Text(f"{self._port} - listening, sends nothing", "italic")
        table = RichTable(title=title, title_justify="left")
        if is_low:
            table.box, table.pad_edge, table.expand = None, False, True
        # In a narrow window the content is cut, never a name or a number.
        names = max(map(len, monitor.types), default=0)
        table.add_column("message", style="cyan", no_wrap=True, min_width=names)
        table.add_column("from", style="dim", no_wrap=True, min_width=6)
        table.add_column("Hz", justify="right", no_wrap=True, min_width=5)
        table.add_column("count", justify="right", no_wrap=True, min_width=5)
        table.add_column("newest", no_wrap=is_low, ratio=1 if is_low else None)
        rates = monitor.rates_hz()
        for name, count in sorted(monitor.types.items()):
            if (self._types and name not in self._types) or count.newest is None:
                continue
            newest = count.newest
            table.add_row(
                name, newest.direction, f"{rates[name]:.1f}", str(count.count), Text(newest.text)
            )
        parts: list[RichTable | Text] = [table, Text(_totals(monitor), style="dim")]
        if not monitor.types and monitor.others:
            parts.append(Text(f"no messages{_others(monitor)}", style="yellow"))
        parts += [
            Text(_stranger(n, h), style="yellow") for n, h in monitor.foreign_catalogues.items()
        ]
        bad = monitor.newest_damage
        if bad is not None:
            more = "…" if len(bad.raw) > _SHOWN_BYTES else ""
            shown = bad.raw[:_SHOWN_BYTES].hex(" ")
            text = f"newest damaged data: {bad.text}: {shown}{more}"
            newest_bad = Text(text, style="red", no_wrap=is_low)
            newest_bad.overflow = "ellipsis" if is_low else "fold"
            parts.append(newest_bad)
        parts.append(Text("Ctrl-C: end", style="dim"))
        return Group(*parts)

    def tick(self, monitor: Monitor, now_ns: HostNs) -> None:  # noqa: ARG002 - the base's interface
        """Redraw four times a second."""
        if now_ns - self._drawn_ns >= _REDRAW_NS:
            self._drawn_ns = now_ns
            self._live.update(self.picture(self._console), refresh=True)

    def __enter__(self) -> Self:
        """Begin to draw."""
        self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Draw the last state and restore the terminal."""
        drop_queued()  # drops older tables
        with contextlib.suppress(OSError):
            self._live.update(self.picture(self._console), refresh=True)
            self._live.stop()


def _rates(monitor: Monitor) -> str:
    rates = monitor.rates_hz()
    found = ", ".join(f"{name} {rate:.1f}" for name, rate in sorted(rates.items()) if rate)
    return f"rates (Hz): {found}" if found else f"{_SILENCE}{_others(monitor)}"


def _others(monitor: Monitor) -> str:
    """Return which other nodes send, if only one node was requested."""
    if monitor.node is None:
        return ""
    others = ", ".join(map(str, sorted(monitor.others)))
    instead = f"; other nodes that send: {others}" if others else ""
    return f" from node {monitor.node}{instead}"


def _totals(monitor: Monitor) -> str:
    frames = sum(count.count for count in monitor.types.values())
    return (
        f"{frames} messages, {monitor.bytes} B, {monitor.damaged} damaged, "
        f"{monitor.rejected} invalid, {monitor.lost} lost"
    )


def _stranger(node: int, value: int) -> str:
    return (
        f"node {node} uses another message catalogue ({value:08x}): fields may be misread; "
        "`sweepctl connect` lists the differences"
    )
