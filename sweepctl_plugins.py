"""Plug-ins: entry points of installed packages that sweepctl uses.

A package declares them in its ``pyproject.toml``, a group for each kind::

    [project.entry-points."sweepctl.planners"]
    spiral = "my_package.spiral:make"

They are found by their metadata and imported only when they are used. One that raises is disabled,
with one line that names its package (a :class:`PluginWarning`). ``docs/plugins.md`` lists what each
group expects. A plug-in is code of its package: it runs with the rights of the user.

This module uses the standard library only, so that every layer of the project can import it.
"""

from __future__ import annotations

import functools
import os
import sys
import warnings
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator
    from importlib.metadata import EntryPoint

GROUPS = {
    "planners": "planner",
    "messages": "message",
    "faults": "fault",
    "rules": "rule",
    "commands": "command",
}
"""Kinds of plug-in, with the word for one of them; the group of entry points is sweepctl.KIND."""
_MARK = b"[sweepctl."
_METADATA = (".dist-info", ".egg-info")


class PluginWarning(UserWarning):
    """A plug-in that is not used; the text names its package and the reason."""


class PluginError(Exception):
    """A plug-in that was asked for and cannot be used; the text names its package."""


class Plugin(NamedTuple):
    """One entry point."""

    kind: str
    """Key of :data:`GROUPS`."""
    name: str
    package: str
    """Name and version of the package that brings it."""
    entry: EntryPoint

    def __str__(self) -> str:
        """For messages."""
        return f"{GROUPS[self.kind]} {self.name!r} of package {self.package}"


def found(kind: str) -> dict[str, Plugin]:
    """Return the plug-ins of one kind by name, without importing them.

    A name that several packages offer is left out; see :func:`clashes`.
    """
    return {name: plugins[0] for name, plugins in _offered(kind).items() if len(plugins) == 1}


def clashes(kind: str) -> dict[str, str]:
    """Return the names that several packages offer, each with the error."""
    return {
        name: f"{GROUPS[kind]} {name!r} is offered by {_listed(plugins)}; uninstall all but one"
        for name, plugins in _offered(kind).items()
        if len(plugins) > 1
    }


def load(plugin: Plugin) -> Any:  # noqa: ANN401 - any object of the package
    """Import a plug-in and return its object.

    Raises:
        PluginError: the import raises; the text names the package.

    """
    try:
        return _loaded(plugin.entry)
    except (Exception, SystemExit) as error:
        raise PluginError(f"{plugin} cannot be loaded: {_shown(error)}") from error


def usable(kind: str) -> Iterator[tuple[Plugin, Any]]:
    """Import every plug-in of a kind; disable one that raises or whose name clashes.

    Yields:
        Each plug-in with its object.

    """
    for text in clashes(kind).values():
        disable(text)
    for plugin in found(kind).values():
        try:
            yield plugin, load(plugin)
        except PluginError as error:
            disable(str(error))


def disable(why: str) -> None:
    """Report a plug-in that is not used; each text once in a process."""
    if why not in _DISABLED:
        _DISABLED.append(why)
        warnings.warn(f"{why}; it is disabled", PluginWarning, stacklevel=2)


_DISABLED: list[str] = []


def disabled() -> tuple[str, ...]:
    """Return the reports so far."""
    return tuple(_DISABLED)


def forget() -> None:
    """Search for plug-ins again, for example after an installation; for tests."""
    _offered.cache_clear()
    _loaded.cache_clear()
    _DISABLED.clear()


def _shown(error: BaseException) -> str:
    """An exception in one line."""
    text = " ".join(str(error).split())[:200]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


@functools.cache
def _loaded(entry: EntryPoint) -> Any:  # noqa: ANN401 - any object of the package
    return entry.load()


@functools.cache
def _offered(kind: str) -> dict[str, list[Plugin]]:
    """Return the plug-ins of a kind by name, those of the same name together."""
    offered: dict[str, list[Plugin]] = {}
    if not _any_installed():
        return offered
    from importlib.metadata import entry_points  # noqa: PLC0415 - takes 20 ms

    for entry in entry_points(group=f"sweepctl.{kind}"):
        package = f"{entry.dist.name} {entry.dist.version}" if entry.dist else "(unknown)"
        plugin = Plugin(kind, entry.name, package, entry)
        known = offered.setdefault(entry.name, [])
        if all(plugin.package != other.package for other in known):  # a folder twice on the path
            known.append(plugin)
    return offered


def _any_installed() -> bool:
    """Return whether some installed package declares a plug-in: a scan of 2 ms, no import."""
    for folder in dict.fromkeys(sys.path):
        try:
            names = [n for n in os.listdir(folder or ".") if n.endswith(_METADATA)]  # noqa: PTH208 - faster
        except OSError:
            continue
        for name in names:
            try:
                with open(os.path.join(folder, name, "entry_points.txt"), "rb") as file:  # noqa: PTH118, PTH123 - faster
                    if _MARK in file.read():
                        return True
            except OSError:
                continue
    return False


def _listed(plugins: list[Plugin]) -> str:
    return " and ".join(sorted(plugin.package for plugin in plugins))
