"""``PORT`` and the options that open it, as one argument of a command."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from tools.cli import options
from tools.cli.configuration import port_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bridge.io.ports import BytePort


@dataclass(frozen=True, slots=True)
class PortAsked:
    """A port with its options from the command line."""

    name: str
    node: int | None
    how: dict[str, Any]
    """Keyword arguments of ``bridge.io.reopening.PortOptions`` and of ``bridge.open``."""
    key_file: Path | None = None

    @property
    def key(self) -> bytes | None:
        """Key that signs motion commands and changes; None: they are not signed.

        Raises:
            KeyFileError: the file cannot be read or contains no key.

        """
        from tools.cli.keyfile import read_key

        return read_key(self.key_file)

    def open(self) -> BytePort:
        """Open the port.

        Raises:
            PortBusyError: another program has the port open.
            PortError: the port does not exist, access is denied, or the name is not a port.

        """
        from bridge.io.reopening import Opener, PortOptions

        return Opener(self.name, PortOptions(**self.how))()


def port_options(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``PORT`` and the options that open it; the command gets one ``port: PortAsked``."""

    def gathered(**given: Any) -> object:  # noqa: ANN401 - click's values
        name, node, key_file = given.pop("port"), given.pop("node"), given.pop("key_file", None)
        how = {key: given.pop(key) for key in ("baud", "bitrate", "lan", "dtr", "rts")}
        return f(port=PortAsked(name, node, how, key_file), **given)

    made = options.port_options(functools.update_wrapper(gathered, f))
    return port_argument(made)


def keyed_port_options(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``PORT``, its options and ``--key-file``, for commands that move or change the robot."""
    return port_options(options.key_option(f))


def port_argument(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``PORT``, which may be the name of a robot; with completion in the shell."""
    # Eager, because the robot's values are the defaults of the other options.
    return click.argument("port", shell_complete=complete_port, callback=port_of, is_eager=True)(f)


def complete_port(
    ctx: click.Context,  # noqa: ARG001 - click's interface
    param: click.Parameter,  # noqa: ARG001 - click's interface
    incomplete: str,
) -> list[str]:
    """Return named robots and the ports that exist; stable names of serial devices come first."""
    from pathlib import Path

    from bridge.errors import ConfigError
    from tools.cli.configuration import load

    folders = (
        (Path("/dev/serial/by-id"), "*"),
        (Path("/dev"), "sweeper*"),
        (Path("/dev"), "ttyUSB*"),
        (Path("/dev"), "ttyACM*"),
    )
    try:
        found = list(load().robots)
    except ConfigError:
        found = []
    found += [str(path) for folder, form in folders for path in sorted(folder.glob(form))]
    found += ["socket://", "rfc2217://", "can:socketcan:can0", "can:slcan:/dev/ttyACM0"]
    return [name for name in found if name.startswith(incomplete)]
