"""``--foxglove [HOST:]PORT``: serve the channels of a log live to Foxglove."""

from __future__ import annotations

import contextlib
import tomllib
from typing import TYPE_CHECKING, Any

import click

from tools.cli import options
from tools.cli.console import inform

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from bridge.view.foxglove.publisher import FoxglovePublisher

_LOOPBACK = "127.0.0.1"


def foxglove_option(f: Callable[..., object]) -> Callable[..., object]:
    """Add ``--foxglove``."""
    return click.option(
        "--foxglove",
        callback=_address,
        metavar="[HOST:]PORT",
        help="Serve the log's channels live to Foxglove, on this machine unless HOST says "
        "otherwise; port 0 is any free one.",
    )(f)


def _address(
    ctx: click.Context, param: click.Parameter, text: str | None
) -> tuple[str, int] | None:
    if text is not None and ":" not in text:
        text = f"{_LOOPBACK}:{text}"
    return options.address(ctx, param, text)


def run_parameters(robot_toml: str, **run: str | float | None) -> dict[str, Any]:
    """Return the parameters of a run: ``robot.KEY`` of the robot file and ``run.NAME``."""
    found: dict[str, Any] = {}
    with contextlib.suppress(tomllib.TOMLDecodeError):
        _flatten(tomllib.loads(robot_toml), "robot", found)
    return found | {f"run.{name}": value for name, value in run.items() if value is not None}


def _flatten(table: Mapping[str, Any], prefix: str, found: dict[str, Any]) -> None:
    for key, value in table.items():
        if isinstance(value, dict):
            _flatten(value, f"{prefix}.{key}", found)
        else:
            found[f"{prefix}.{key}"] = value


@contextlib.contextmanager
def live_foxglove(
    address: tuple[str, int] | None, parameters: Mapping[str, Any]
) -> Iterator[FoxglovePublisher | None]:
    """Serve a run to Foxglove; without an address do nothing.

    Yields:
        The object that gets each chunk from the log's writer; None without an address.

    Raises:
        FoxgloveMissingError: foxglove-sdk is not installed.
        FoxgloveServerError: the server cannot listen on the address.

    """
    if address is None:
        yield None
        return
    from bridge.view.foxglove.publisher import FoxglovePublisher
    from tools.cli.lan_risk import viewer_risk

    publisher = FoxglovePublisher(*address, parameters)
    try:
        inform(f"Foxglove: {publisher.address}")
        risk = viewer_risk(address[0])
        if risk is not None:
            inform(risk, style="yellow")
        yield publisher
    finally:
        publisher.close()
        if publisher.dropped:
            inform(f"{publisher.dropped} messages were not sent to Foxglove: it was too slow")
