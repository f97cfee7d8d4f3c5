"""Selection of runs by a user's SQL condition. It can read only the table of runs."""

from __future__ import annotations

import re
import sqlite3
from dataclasses import dataclass
from typing import Any

from bridge.library.columns import NAMES
from bridge.library.errors import LibraryError
from bridge.spelling import nearest

_STEPS = 200_000_000
"""Maximum number of steps of SQLite's virtual machine for a query. They take about ten seconds.
Then the query is aborted."""
_STEPS_A_CALL = 1_000_000
_FUNCTIONS = frozenset(
    [
        "abs",
        "avg",
        "coalesce",
        "count",
        "date",
        "datetime",
        "glob",
        "ifnull",
        "iif",
        "instr",
        "julianday",
        "length",
        "like",
        "lower",
        "ltrim",
        "max",
        "min",
        "nullif",
        "round",
        "rtrim",
        "strftime",
        "substr",
        "sum",
        "time",
        "total",
        "trim",
        "typeof",
        "unixepoch",
        "upper",
    ]
)
"""Functions of a condition. One call of each is short: SQLite cannot interrupt a call."""
_ALLOWED = frozenset({sqlite3.SQLITE_SELECT, sqlite3.SQLITE_FUNCTION, sqlite3.SQLITE_READ})


@dataclass(frozen=True, slots=True)
class Selection:
    """A selection of runs and their order."""

    where: str = ""
    """SQL condition over the columns; empty: all runs."""
    sort: str = "date"
    """Column to sort by; a minus sign before it reverses the order."""
    tags: tuple[str, ...] = ()
    """Tags that a run must have."""
    last: int | None = None
    """Maximum number of runs, from the end of the list; None: all runs."""

    def rows(self, database: sqlite3.Connection) -> list[tuple[Any, ...]]:
        """Return the rows of the selected runs. The connection is read-only during the query.

        Raises:
            LibraryError: the condition is not SQL over the columns, or a column does not exist.

        """
        database.set_authorizer(_authorise)
        steps = [0]

        def count() -> int:
            steps[0] += _STEPS_A_CALL
            return int(steps[0] > _STEPS)

        database.set_progress_handler(count, _STEPS_A_CALL)
        try:
            rows = database.execute(*_query(self)).fetchall()
        except sqlite3.Error as error:
            raise LibraryError(_explained(self.where, error)) from None
        finally:
            database.set_authorizer(None)
            database.set_progress_handler(None, 0)
        return rows if self.last is None else rows[max(0, len(rows) - self.last) :]


def _query(selection: Selection) -> tuple[str, tuple[str, ...]]:
    column = selection.sort.removeprefix("-")
    if column not in NAMES:
        raise LibraryError(f"no column {column!r} to sort by; {_hint(column)}")
    order = "DESC" if selection.sort.startswith("-") else "ASC"
    conditions = [*(["(\n" + selection.where + "\n)"] if selection.where.strip() else [])]
    conditions += ["instr(tags, ?)"] * len(selection.tags)
    where = f"WHERE {' AND '.join(conditions)}" if conditions else ""
    # The user's condition is safe: it runs on a copy, read-only, with an authorizer.
    text = f'SELECT * FROM runs {where} ORDER BY "{column}" {order}, modified_ns {order}'  # noqa: S608 - see above
    return text, tuple(f" {tag} " for tag in selection.tags)


def _authorise(action: int, first: str | None, second: str | None, *_: str | None) -> int:
    """Allow only reads of the table of runs, and the functions in ``_FUNCTIONS``."""
    if action not in _ALLOWED:
        return sqlite3.SQLITE_DENY
    if action == sqlite3.SQLITE_READ and first != "runs":
        return sqlite3.SQLITE_DENY
    if action == sqlite3.SQLITE_FUNCTION and second not in _FUNCTIONS:
        return sqlite3.SQLITE_DENY
    return sqlite3.SQLITE_OK


def _explained(where: str, error: sqlite3.Error) -> str:
    text = str(error)
    unknown = re.search(r"no such column: (\S+)", text)
    if unknown is not None:
        return f"no column {unknown[1]!r}; {_hint(unknown[1])}"
    function = re.search(r"not authorized to use function: (\S+)", text)
    if function is not None:
        return f"no function {function[1]!r}; there are {', '.join(sorted(_FUNCTIONS))}"
    if "not authorized" in text or "prohibited" in text:
        return f"the condition {where!r} does more than read runs"
    if text == "interrupted":
        return f"the condition {where!r} takes too long"
    cause = text.partition("\n")[0]  # the other lines are from our part of the query
    return f"the condition {where!r} is not SQL over the columns: {cause}"


def _hint(name: str) -> str:
    near = nearest(name, NAMES)
    return f"did you mean {near}?" if near else f"there are {', '.join(NAMES)}"
