"""What the bench commands share: the desk on a port, and the person at the terminal."""

from __future__ import annotations

import contextlib
import math
import secrets
import sys
import threading
from typing import TYPE_CHECKING, TextIO

import click

from tools.stopping import until_signalled

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from bridge.bench.desk import Desk
    from tools.port_options import PortAsked

_LONG_S = 1e6


@contextlib.contextmanager
def desk_on(asked: PortAsked) -> Iterator[Desk]:
    """A desk on a port; Ctrl-C ends what it does, and it leaves the robot stopped.

    Raises:
        PortError: the port cannot be opened, or nothing answers on it.
        DisagreementError: the device speaks another protocol.

    """
    from bridge.bench.desk import Desk
    from bridge.io.wire import PortWire

    key = asked.key
    wire = PortWire(asked.open())
    try:
        desk = Desk(wire, lambda: secrets.randbelow(0xFFFF_FFFE) + 1, node=asked.node, key=key)
    except BaseException:
        wire.close()
        raise
    with until_signalled(desk.interrupt), desk:
        yield desk


class Terminal:
    """The person at this terminal; the device is kept company while an answer is awaited."""

    def __init__(self, desk: Desk, *, yes: bool = False, source: TextIO | None = None) -> None:
        """With ``yes`` every confirmation is given beforehand."""
        self._desk, self._yes = desk, yes
        self._source = source or sys.stdin

    def tell(self, text: str) -> None:
        """Print a line."""
        colour = None
        if ": WRONG: " in text:
            colour = "red"
        elif ": ok: " in text:
            colour = "green"
        elif ": left out: " in text:
            colour = "yellow"
        click.secho(text, err=True, fg=colour)

    def confirm(self, text: str) -> bool:
        """Ask for a yes; the end of the input is a no."""
        if self._yes:
            self.tell(f"{text} yes (--yes)")
            return True
        while True:
            said = self._line(f"{text} [y/n] ")
            if said is None or said.lower() in {"n", "no"}:
                return False
            if said.lower() in {"y", "yes"}:
                return True

    def choose(self, text: str, answers: Mapping[str, str]) -> str:
        """Ask for one of the keys; the end of the input is the last."""
        self.tell(text)
        for key, meaning in answers.items():
            self.tell(f"  {key:3} {meaning}")
        while True:
            said = self._line("> ")
            if said is None:
                return list(answers)[-1]
            if said.lower() in answers:
                return said.lower()

    def number(self, text: str) -> float:
        """Ask for a number.

        Raises:
            click.UsageError: the input ended.

        """
        while True:
            said = self._line(f"{text}: ")
            if said is None:
                raise click.UsageError(f"no answer to: {text}")
            with contextlib.suppress(ValueError):
                value = float(said)
                if math.isfinite(value):
                    return value

    def _line(self, prompt: str) -> str | None:
        """A line of input, stripped; None at its end. Time goes on for the device."""
        sys.stderr.write(prompt)
        sys.stderr.flush()
        answers: list[str] = []
        done = threading.Event()

        def read() -> None:
            try:
                answers.append(self._source.readline())
            except (OSError, ValueError):  # the terminal went away
                answers.append("")
            done.set()

        threading.Thread(target=read, name="answer", daemon=True).start()
        self._desk.run(_LONG_S, done.is_set)
        return answers[0].strip() if answers[0] else None


def clear_stop_option(f: Callable[..., object]) -> Callable[..., object]:
    """``--clear-stop``."""
    return click.option(
        "--clear-stop",
        is_flag=True,
        help="Also clear a stop that was latched for safety. Look first.",
    )(f)
