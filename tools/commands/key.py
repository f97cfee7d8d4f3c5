"""``sweepctl key``: set or remove the key that authenticates a robot's motion commands."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from tools.cli import options
from tools.cli.console import inform, write_json
from tools.cli.interrupt import set_done
from tools.cli.paths import PathName
from tools.cli.port_options import port_argument

if TYPE_CHECKING:
    from pathlib import Path


@click.command("key", epilog="Example:  sweepctl key /dev/ttyUSB0 --set robot.key")
@port_argument
@click.option(
    "--set",
    "new",
    type=PathName(dir_okay=False),
    help="Write a new random key to this file and to the robot.",
)
@click.option("--clear", is_flag=True, help="Remove the key: everyone can drive the robot again.")
@options.key_option
@options.port_options
@options.json_option
def command(
    *,
    port: str,
    new: Path | None,
    clear: bool,
    key_file: Path | None,
    as_json: bool,
    **opening: Any,  # noqa: ANN401 - options of the port, declared above
) -> int:
    """Set, replace or remove the key that authenticates motion of the robot on PORT.

    A robot with a key accepts motion commands and changes only from a host that has the key. It
    accepts a stop from every host. To replace or remove a key, give the present one with
    --key-file.

    A key can be set only over a local serial port, and the robot never discloses it. If you lose
    the key file, reset the robot to its factory settings.
    """
    import bridge
    from bridge.errors import CommandRejectedError, KeyExposedError
    from bridge.io.ports import check_local
    from tools.cli.keyfile import make_key, read_key

    if (new is None) == (not clear):
        raise click.UsageError("give --set FILE or --clear")
    try:
        check_local(port)
    except KeyExposedError as error:
        raise click.UsageError(str(error)) from None
    present = read_key(key_file)
    with bridge.open(port, key=present, **opening) as robot:
        made = None if new is None else make_key(new)
        try:
            robot.set_key(made)
        except CommandRejectedError:
            if new is not None:
                new.unlink()  # the robot does not have the key
            raise
        except BaseException:
            if new is not None:  # keep the file, because the robot may have stored the key
                inform(
                    f"the robot may have stored the key, so {new} is kept; if the robot rejects "
                    f"--key-file {new}, delete the file"
                )
            raise
        if as_json:  # before the port is closed, which Ctrl-C may interrupt
            write_json({"port": port, "key": made is not None})
        else:
            what = f"set; keep {new}, it is the only copy" if new else "removed"
            inform(f"{port}: the key is {what}")
        set_done()
    return 0
