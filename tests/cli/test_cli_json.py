"""The output of ``--json`` matches the JSON Schemas."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING, Any

import click
import pytest

from support.cli import short_runs, sweepctl
from support.json_schema import (
    ANY,
    command_of,
    commands,
    output_problems,
    problems,
    schema_of,
    schemas,
)
from support.small_logs import write_log
from tools.dev.json_schemas import PATH, with_schemas

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

WITH_JSON = sorted(
    name
    for name, command in commands()
    if any("--json" in option.opts for option in command.params if isinstance(option, click.Option))
)


def test_every_command_with_json_has_a_schema_and_every_schema_a_command() -> None:
    described = [name for schema in schemas().values() for name in schema["x-commands"]]
    assert sorted(described) == sorted([*WITH_JSON, ANY])
    assert len(WITH_JSON) > 30


def test_the_page_lists_the_schemas() -> None:
    text = PATH.read_text("utf-8")
    assert with_schemas(text) == text, "run `python -m tools.dev.json_schemas`"


def test_each_schema_names_its_dialect_and_has_a_title() -> None:
    for name, schema in schemas().items():
        assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema", name
        assert schema["title"], name


OUTPUTS = (
    ("simulate", "empty", "--max-time", "8"),
    ("simulate", "nowhere"),
    ("info", "long.mcap"),
    ("info", "cut.mcap"),
    ("report", "long.mcap", "--out", "r.html"),
    ("diff", "long.mcap", "long.mcap"),
    ("doctor", "long.mcap"),
    ("export", "long.mcap", "--out", "tables", "--topic", "/device/*"),
    ("recover", "cut.mcap", "--out", "whole.mcap"),
    ("replay", "long.mcap", "--check"),
    ("runs", "."),
    ("runs", "columns"),
    ("runs", "tag", "small.mcap", "a"),
    ("runs", "note", "small.mcap", "b"),
    ("runs", "compare", "."),
    ("runs", "heatmap", ".", "--out", "h.png"),
    ("robot", "check", "robot.toml"),
    ("robot", "show", "robot.toml"),
    ("room", "check", "case-1"),
    ("room", "show", "case-1"),
    ("config", "show"),
    ("ports",),
)


def test_real_outputs_are_as_described(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    log = tmp_path / "long.mcap"
    shutil.copy(short_runs(tmp_path_factory)[0].log, log)
    data = log.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: len(data) // 2])
    write_log(tmp_path / "small.mcap")
    assert sweepctl("robot", "new", "robot.toml").status == 0
    for words in OUTPUTS:
        done = sweepctl(*words, "--json")
        lines = done.out.splitlines()
        assert len(lines) == 1, words
        command = command_of(words)
        assert command is not None
        value = json.loads(lines[0])
        assert output_problems(command, value) == []
        # The check can fail: an object without one of its keys does not match.
        schema = schema_of(command)
        assert schema is not None
        for key in schema.get("required", ()):
            if "nowhere" not in words:
                less = {name: inner for name, inner in value.items() if name != key}
                assert any(key in text for text in output_problems(command, less)), (words, key)
        assert (
            output_problems(command, {**value, "undescribed": 1})
            or command == "robot show"
            or (schema.get("additionalProperties") is True)
        )


SCHEMA: dict[str, Any] = {
    "type": "object",
    "properties": {
        "n": {"type": ["integer", "null"]},
        "x": {"type": "number"},
        "list": {"type": "array", "items": {"$ref": "#/$defs/word"}},
        "map": {"type": "object", "additionalProperties": {"type": "boolean"}},
        "either": {"anyOf": [{"const": 1}, {"type": "string"}]},
    },
    "required": ["n"],
    "$defs": {"word": {"type": "string", "enum": ["a", "b"]}},
}


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ({"n": 1, "x": 2, "list": ["a", "b"], "map": {"any": True}, "either": "s"}, None),
        ({"n": None, "x": 2.5, "either": 1}, None),
        ({}, "$: n is missing"),
        ({"n": 1.5}, "$.n: 1.5 is not ['integer', 'null']"),
        ({"n": True}, "$.n: True is not"),
        ({"n": 1, "list": ["c"]}, "$.list[0]: 'c' is not one of"),
        ({"n": 1, "map": {"k": 1}}, "$.map.k: 1 is not boolean"),
        ({"n": 1, "either": 2}, "$.either: 2 is not"),
        ({"n": 1, "more": 2}, "$: more is not described"),
        ([], "$: [] is not object"),
    ],
)
def test_the_check_finds_errors(value: object, text: str | None) -> None:
    found = list(problems(value, SCHEMA, SCHEMA))
    assert len(found) == (text is not None)
    assert text is None or text in found[0]


def test_a_keyword_that_the_check_does_not_know_is_an_error() -> None:
    with pytest.raises(AssertionError, match="pattern"):
        list(problems("a", {"type": "string", "pattern": "b"}, {}))
