"""``sweepctl key``: the key that a robot's motion is authenticated with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from tools.cli import options
from tools.cli.console import inform, write_json
from tools.cli.interrupt import set_done
from tools.cli.port_options import port_argument


@click.command("key", epilog="Example:  sweepctl key /dev/ttyUSB0 --set robot.key")
@port_argument
@click.option(
    "--set",
    "new",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Write a new random key to this file and send it to the robot.",
)
@click.option("--clear", is_flag=True, help="Remove the key, so that anyone may drive.")
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
    **opening: Any,  # noqa: ANN401 - node, baud, bitrate, lan, dtr and rts, as declared
) -> int:
    """Set, replace or remove the key of the robot on PORT.

    With a key, a robot accepts motion commands and changes only from hosts that have the key. It
    accepts a stop from anyone. A key can be set only over the robot's local serial port and cannot
    be read back: without the file you need the robot's factory reset. To replace or remove a key,
    give the current one with --key-file.
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
                new.unlink()  # the robot does not have it
            raise
        except BaseException:
            if new is not None:  # it may have the key, and nobody else would
                inform(
                    f"the robot may have taken the key: {new} is kept; if the robot obeys with "
                    f"--key-file {new} it has, else delete the file"
                )
            raise
        if as_json:  # before the port is closed, which Ctrl-C may cut off
            write_json({"port": port, "key": made is not None})
        else:
            said = f"set; keep {new}: it is told nowhere else" if new else "removed"
            inform(f"{port}: the key is {said}")
        set_done()
    return 0
