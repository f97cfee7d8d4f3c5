"""Configuration files: defaults of options, and robots by name.

Later files have priority: ``$XDG_CONFIG_HOME/sweepctl/config.toml``, then ``./sweepctl.toml``. If
``$SWEEPCTL_CONFIG`` is set, only the file that it names is read; if it is empty, no file. An option
on the command line has priority over every file.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from tools.cli.console import inform

if TYPE_CHECKING:
    from collections.abc import Mapping

VARIABLE = "SWEEPCTL_CONFIG"
LOCAL = Path("sweepctl.toml")
NOISE_LEVELS = ("none", "paper", "typical", "harsh")
_META = "sweepctl.configuration"
_ROBOT = "sweepctl.named_robot"
_MAX_BYTES = 64 * 1024
_MAX_TEXT = 1000
"""Maximum length of a text in a file, characters: a path."""


def _text(path: str, value: object) -> str:
    from bridge.errors import ConfigError

    if not isinstance(value, str) or not 0 < len(value) <= _MAX_TEXT or "\0" in value:
        raise ConfigError(f"{path}: must be a text of 1 to {_MAX_TEXT} characters")
    return value


def _whole(low: int, high: int) -> Any:  # noqa: ANN401 - the reader of a field
    def read(path: str, value: object) -> int:
        from bridge.errors import ConfigError
        from bridge.validation import number

        found = number(path, value, low, high)
        if not isinstance(value, int):
            raise ConfigError(f"{path}: {value!r} is not a whole number")
        return int(found)

    return read


def _choice(*allowed: str) -> Any:  # noqa: ANN401 - the reader of a field
    def read(path: str, value: object) -> str:
        from bridge.errors import ConfigError, shown

        if value not in allowed:
            raise ConfigError(f"{path}: {shown(value)} is not one of {', '.join(allowed)}")
        return str(value)

    return read


def _key(meaning: str, read: Any = _text, built_in: str = "") -> Any:  # noqa: ANN401 - a dataclass field
    metadata = {"read": read, "meaning": meaning, "built_in": built_in}
    return field(default=None, metadata=metadata)


@dataclass(frozen=True, slots=True)
class Shared:
    """Keys that ``[defaults]`` and robots have in common."""

    robot: str | None = _key("robot file", built_in="the paper's robot")
    key_file: str | None = _key("key file; the key itself never stands in a configuration file")
    node: int | None = _key("node number of the device, 1 to 15", _whole(1, 15))
    baud: int | None = _key("baud rate of a real serial port", _whole(1200, 12_000_000), "921600")
    bitrate: int | None = _key("CAN bit rate", _whole(10_000, 1_000_000), "500000")


@dataclass(frozen=True, slots=True)
class Defaults(Shared):
    """Table ``[defaults]``: values for options that are not on the command line."""

    planner: str | None = _key("planner of `simulate`", built_in="recovery")
    noise: str | None = _key(
        "noise level of the virtual sweeper",
        _choice(*NOISE_LEVELS),
        "typical",
    )


@dataclass(frozen=True, slots=True)
class NamedRobot(Shared):
    """Table ``[robots.NAME]``: the settings of a robot whose NAME is given as PORT."""

    port: str | None = _key("the port; required")


PATHS = frozenset({"robot", "key_file"})
"""Keys whose value is a path, relative to the folder of the file."""


@dataclass(frozen=True, slots=True)
class Value:
    """A value and its source."""

    value: str | int
    source: str


@dataclass(frozen=True, slots=True)
class Configuration:
    """Content of all configuration files."""

    files: tuple[tuple[Path, bool], ...] = ()
    """Files in ascending order of priority, and whether each exists."""
    defaults: Mapping[str, Value] = field(default_factory=dict)
    robots: Mapping[str, Mapping[str, Value]] = field(default_factory=dict)


def config_files() -> list[Path]:
    """Return the files that are read if they exist, in ascending order of priority."""
    named = os.environ.get(VARIABLE)
    if named is not None:
        return [Path(named)] if named else []
    home = os.environ.get("XDG_CONFIG_HOME", "")
    folder = Path(home) if home.startswith("/") else Path("~/.config").expanduser()
    return [folder / "sweepctl" / "config.toml", LOCAL]


def load() -> Configuration:
    """Read the configuration files.

    Raises:
        ConfigError: a file cannot be read, or a key is wrong; the text names file and key.

    """
    files: list[tuple[Path, bool]] = []
    defaults: dict[str, Value] = {}
    robots: dict[str, dict[str, Value]] = {}
    sources: dict[str, str] = {}
    for path in config_files():
        tables = _read(path)
        files.append((path, tables is not None))
        if tables is None:
            continue
        defaults |= _values(path, tables[0])
        for name, robot in tables[1].items():
            robots[name] = {**robots.get(name, {}), **_values(path, robot)}
            sources.setdefault(name, str(path))
    _check_ports(robots, sources)
    return Configuration(tuple(files), defaults, robots)


def _check_ports(robots: Mapping[str, Mapping[str, Value]], sources: Mapping[str, str]) -> None:
    from bridge.errors import ConfigError

    lacking = [name for name, robot in robots.items() if "port" not in robot]
    if lacking:
        missing = (f"robots.{name}.port: is missing" for name in lacking)
        raise ConfigError(*missing, source=sources[lacking[0]])


def _read(path: Path) -> tuple[Defaults, dict[str, NamedRobot]] | None:
    """Read one file; None: the file does not exist."""
    from bridge.errors import ConfigError
    from bridge.spelling import unknown_key
    from bridge.validation import fill, load_toml

    text = _content(path)
    if text is None:
        return None
    data = load_toml(text, str(path))
    problems = [unknown_key("", key, _TABLES) for key in data if key not in _TABLES]
    defaults = _table(data.get("defaults", {}), "defaults", problems)
    found = fill(Defaults(), defaults, "defaults.", problems)
    robots: dict[str, NamedRobot] = {}
    for name, given in _table(data.get("robots", {}), "robots", problems).items():
        if not name or any(character in name for character in _NO_NAME):
            problems.append(f"robots.{name}: a name has no slash, colon, dot or space")
        table = _table(given, f"robots.{name}", problems)
        robots[name] = fill(NamedRobot(), table, f"robots.{name}.", problems)
    if problems:
        raise ConfigError(*problems, source=str(path))
    return found, robots


_TABLES = ("defaults", "robots")
_NO_NAME = "/\\:. "
"""Characters that are allowed in a port, but not in the name of a robot."""


def _table(value: object, path: str, problems: list[str]) -> dict[str, Any]:
    if isinstance(value, dict):
        return value
    problems.append(f"{path}: must be a table")
    return {}


def _content(path: Path) -> str | None:
    """Return the text of a file; None: there is no file, and ``SWEEPCTL_CONFIG`` names none."""
    from bridge.errors import ConfigError
    from bridge.files import open_to_read

    try:
        with open_to_read(path) as file:
            content = file.read(_MAX_BYTES + 1)
        if len(content) > _MAX_BYTES:
            raise ConfigError(f"{path} is larger than {_MAX_BYTES} bytes")
        return content.decode()
    except FileNotFoundError:
        if os.environ.get(VARIABLE):
            raise ConfigError(f"there is no file {path} ({VARIABLE})") from None
        return None
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path} is not UTF-8 text") from None


def _values(path: Path, table: Defaults | NamedRobot) -> dict[str, Value]:
    """Return the values in a file; relative paths begin at the folder of the file."""
    found: dict[str, Value] = {}
    for each in fields(table):
        value = getattr(table, each.name)
        if value is None:
            continue
        if each.name in PATHS:
            value = str(path.parent / Path(value).expanduser())
        found[each.name] = Value(value, str(path))
    return found


def configuration(ctx: click.Context) -> Configuration:
    """Return the configuration, read once for a command.

    A file that cannot be used is an error, except for ``stop``, which must always work.

    Raises:
        ConfigError: as for :func:`load`.

    """
    from bridge.errors import ConfigError

    if _META not in ctx.meta:
        try:
            ctx.meta[_META] = load()
        except ConfigError as error:
            if ctx.command.name != "stop":
                raise
            inform(f"warning: {error}; it is ignored")
            ctx.meta[_META] = Configuration()
    found: Configuration = ctx.meta[_META]
    return found


def given(name: str) -> bool:
    """Return whether the command line has an option; a default or a file does not count."""
    source = click.get_current_context().get_parameter_source(name)
    return source is ParameterSource.COMMANDLINE


def port_of(ctx: click.Context, param: click.Parameter, value: str | None) -> str | None:
    """Return the port of a named robot, or the value itself; for the argument PORT.

    Raises:
        click.BadParameter: the value resembles the name of a robot, and is neither name nor port.

    """
    from bridge.spelling import nearest
    from tools.cli.paths import is_there

    if value is None or ctx.resilient_parsing or any(c in value for c in _NO_NAME):
        return value
    robots = configuration(ctx).robots
    robot = robots.get(value)
    if robot is not None:
        ctx.meta[_ROBOT] = {key: each for key, each in robot.items() if key != "port"}
        port = robot["port"]
        inform(f"{value}: port {port.value} ({port.source})")
        return str(port.value)
    near = nearest(value, robots)
    if near is not None and not is_there(Path(value)):
        raise click.BadParameter(
            f"there is no robot {value!r}; did you mean {near!r}? `sweepctl config show` lists "
            f"robots",
            ctx,
            param,
        )
    return value


@dataclass(frozen=True, slots=True)
class Named:
    """A robot of the command line: a port, or a name with its values from the files."""

    given: str
    """The word of the command line."""
    port: str
    values: Mapping[str, Value]
    """Values of the named robot; empty for a port."""


def robots_of(
    ctx: click.Context, param: click.Parameter, values: tuple[str, ...]
) -> tuple[Named, ...]:
    """Return several names or ports, each with its own values.

    Raises:
        click.BadParameter: as for :func:`port_of`.

    """
    found: list[Named] = []
    for value in values:
        ctx.meta.pop(_ROBOT, None)
        port = port_of(ctx, param, value)
        found.append(Named(value, port or value, ctx.meta.pop(_ROBOT, {})))
    return tuple(found)


class ConfiguredOption(click.Option):
    """Option whose default a configuration file may set, under the name of the option."""

    takes_defaults = True
    """False: only the table of the named robot counts."""

    def consume_value(
        self,
        ctx: click.Context,
        opts: Mapping[str, Any],
    ) -> tuple[Any, ParameterSource]:
        """Return the value of the command line, else of the named robot, else of a file."""
        value, source = super().consume_value(ctx, opts)
        if source not in {ParameterSource.DEFAULT, ParameterSource.DEFAULT_MAP}:
            return value, source
        if ctx.resilient_parsing or self.name is None:
            return value, source
        found = _named(ctx, self.name)
        if found is None and self.takes_defaults:
            found = configuration(ctx).defaults.get(self.name)
        if found is None:
            return value, source
        inform(f"{self.opts[0]} {found.value} ({found.source})")
        return found.value, ParameterSource.DEFAULT_MAP


class RobotsOwnOption(ConfiguredOption):
    """Option whose default is the value of the named robot, and never a value of ``[defaults]``."""

    takes_defaults = False


class RobotsOwnFile(click.Argument):
    """Argument whose default is the robot file of the named robot."""

    def consume_value(
        self,
        ctx: click.Context,
        opts: Mapping[str, Any],
    ) -> tuple[Any, ParameterSource]:
        """Return the value of the command line, else of the named robot.

        Raises:
            click.MissingParameter: neither of them has a value.

        """
        value, source = super().consume_value(ctx, opts)
        if source is not ParameterSource.DEFAULT or ctx.resilient_parsing:
            return value, source
        found = _named(ctx, "robot")
        if found is None:
            raise click.MissingParameter(ctx=ctx, param=self)
        inform(f"robot file {found.value} ({found.source})")
        return found.value, ParameterSource.DEFAULT_MAP


def _named(ctx: click.Context, key: str) -> Value | None:
    """Return a value of the robot that the command line names."""
    named: Mapping[str, Value] = ctx.meta.get(_ROBOT, {})
    return named.get(key)
