"""Options that several commands share."""

from __future__ import annotations

import math
import secrets
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections.abc import Callable

NOISE_LEVELS = ("none", "paper", "typical", "harsh")
PLANNERS = ("paper", "u-shape", "random")
DEFAULT_PLANNER = "paper"


class Seconds(click.FloatRange):
    """A time in a range; "nan" is in none."""

    def convert(
        self,
        value: Any,  # noqa: ANN401 - click's interface
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> float:
        """Read the number."""
        number = super().convert(value, param, ctx)
        if math.isnan(number):
            self.fail(f"{value!r} is not a time.", param, ctx)
        return number


def out_option(f: Callable[..., object]) -> Callable[..., object]:
    """``--out`` and ``--force``."""
    f = click.option("--force", is_flag=True, help="Replace the log file if it exists.")(f)
    return click.option(
        "--out",
        type=click.Path(dir_okay=False, path_type=Path),
        help="Log file; default runs/<UTC>-<name>.mcap.",
    )(f)


def json_option(f: Callable[..., object]) -> Callable[..., object]:
    """``--json``."""
    return click.option(
        "--json",
        "as_json",
        is_flag=True,
        help="Print one JSON object on stdout; everything for people goes to stderr.",
    )(f)


def robot_option(f: Callable[..., object]) -> Callable[..., object]:
    """``--robot``."""
    return click.option(
        "--robot",
        type=click.Path(dir_okay=False, path_type=Path),
        help="Robot file (TOML); default: the paper's robot.",
    )(f)


def noise_option(f: Callable[..., object]) -> Callable[..., object]:
    """``--noise``."""
    return click.option(
        "--noise",
        type=click.Choice(NOISE_LEVELS),
        default="typical",
        show_default=True,
        help="How imperfect the virtual sensors and wheels are.",
    )(f)


def seed_option(f: Callable[..., object]) -> Callable[..., object]:
    """``--seed``."""
    return click.option(
        "--seed",
        type=click.IntRange(0, 2**63 - 1),
        default=0,
        show_default=True,
        help="Equal seeds give equal runs.",
    )(f)


def log_path(out: Path | None, name: str) -> Path:
    """The log to write; a default one gets its folder.

    Raises:
        LogWriteError: that folder cannot be made.

    """
    if out is not None:
        return out
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")  # noqa: TID251 - names a file
    clean = "".join(c if c.isalnum() or c in "-_." else "-" for c in name).strip("-.") or "run"
    path = Path("runs") / f"{stamp}-{clean}.mcap"
    try:
        path.parent.mkdir(exist_ok=True)
    except OSError as error:
        from bridge.record.errors import LogWriteError

        raise LogWriteError(path, error.strerror or str(error)) from None
    while path.exists():  # two runs in one second
        path = path.with_name(f"{stamp}-{clean}-{secrets.token_hex(2)}.mcap")
    return path
