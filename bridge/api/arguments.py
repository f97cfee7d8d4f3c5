"""Checks of API arguments, before anything is sent or opened."""

from __future__ import annotations

import functools
import inspect
import math
from dataclasses import dataclass
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec, TypeVar

from bridge.errors import ArgumentError, shown
from bridge.floor_plan.floor_plan import FloorPlan
from bridge.motion.robot_model import RobotModel
from protocol.authentication import KEY_SIZE
from protocol.uart.framing import MAX_NODE

if TYPE_CHECKING:
    from collections.abc import Callable

P = ParamSpec("P")
R = TypeVar("R")


@dataclass(frozen=True, slots=True)
class ArgumentKind:
    """Allowed type and range of an argument."""

    wanted: str
    """Description for the error text, after "must be"."""
    fits: Callable[[object], bool]
    secret: bool = False
    """True if error texts must not show the value."""

    def __or__(self, other: ArgumentKind) -> ArgumentKind:
        """Return a kind that allows the values of both kinds."""
        return ArgumentKind(
            f"{self.wanted}, or {other.wanted}",
            lambda value: self.fits(value) or other.fits(value),
            self.secret or other.secret,
        )


def checked(**kinds: ArgumentKind) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return a decorator that raises :class:`ArgumentError` for arguments not of these kinds."""

    def wrap(call: Callable[P, R]) -> Callable[P, R]:
        signature = inspect.signature(call)

        @functools.wraps(call)
        def checking(*args: P.args, **kwargs: P.kwargs) -> R:
            for name, value in signature.bind(*args, **kwargs).arguments.items():
                kind = kinds.get(name)
                if kind is not None and not kind.fits(value):
                    given = name if kind.secret else f"{name} = {shown(value)}"
                    raise ArgumentError(f"{given}: must be {kind.wanted}")
            return call(*args, **kwargs)

        return checking

    return wrap


def _instance(wanted: str, *types: type) -> ArgumentKind:
    return ArgumentKind(wanted, lambda value: isinstance(value, types))


def _is_number(value: object, least: float = -math.inf) -> bool:
    if isinstance(value, bool) or not isinstance(value, Real):
        return False
    try:
        return least <= float(value) < math.inf and float(value) > -math.inf
    except OverflowError:  # an integer beyond float range
        return False


def _whole(wanted: str, low: int, high: int) -> ArgumentKind:
    def fits(value: object) -> bool:
        if isinstance(value, bool) or not isinstance(value, Integral):
            return False
        return low <= int(value) <= high

    return ArgumentKind(wanted, fits)


def _is_key(value: object) -> bool:
    return isinstance(value, bytes) and len(value) == KEY_SIZE and any(value)


NONE = ArgumentKind("None", lambda value: value is None)
FLAG = _instance("True or False", bool)
TEXT = _instance("a text", str)
PATH = _instance("a path", str, Path)
MODEL = _instance("a RobotModel", RobotModel)
ROOM = _instance("a FloorPlan", FloorPlan)
SINK = ArgumentKind("an object with write()", lambda value: callable(getattr(value, "write", None)))
NUMBER = ArgumentKind("a finite number", _is_number)
SECONDS = ArgumentKind("a number of seconds, 0 or more", lambda value: _is_number(value, 0.0))
NODE = _whole(f"an integer from 1 to {MAX_NODE}", 1, MAX_NODE)
BITS_PER_S = _whole("an integer from 1 to 4294967295", 1, 0xFFFF_FFFF)
KEY = ArgumentKind(f"{KEY_SIZE} bytes that are not all 0", _is_key, secret=True)
PARAMETER = ArgumentKind(
    "a parameter's name or number",
    lambda value: isinstance(value, str | Integral) and not isinstance(value, bool),
)
VALUE = _instance("a number, a text, True or False", Real, str)
"""Type of a parameter's value; the parameter itself checks the range."""
HERTZ = ArgumentKind(
    "a number", lambda value: isinstance(value, Real) and not isinstance(value, bool)
)
