"""The CI examples for users: run unchanged, or compared with the commands."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import click
import pytest

from support.root import ROOT
from tools.cli.main import cli

pytestmark = pytest.mark.realtime

EXAMPLES = ROOT / "examples" / "ci"
BASH = shutil.which("bash") or "bash"
PAGE = ROOT / "docs" / "ci.md"


def with_sweepctl(folder: Path) -> dict[str, str]:
    """Return an environment whose ``sweepctl`` and ``python`` are those of this source tree."""
    binaries = folder / "bin"
    binaries.mkdir()
    command = binaries / "sweepctl"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m tools.sweepctl "$@"\n')
    command.chmod(0o755)
    path = os.pathsep.join([str(binaries), str(Path(sys.executable).parent), os.environ["PATH"]])
    return {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT), "TMPDIR": str(folder)}


def test_the_script_runs_as_it_stands(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    done = subprocess.run(
        [BASH, EXAMPLES / "emulated-run.sh", out],
        env=with_sweepctl(tmp_path),
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"done: {out / 'run.mcap'}\n"
    summary = json.loads((out / "run.json").read_text())
    assert summary["outcome"] == "stopped"
    assert summary["wire"]["crc_errors"] == 0
    assert json.loads((out / "truth.json").read_text())["truth"]["path_m"] > 0.1
    assert sorted(p.name for p in out.iterdir()) == ["run.json", "run.mcap", "truth.json"]
    runtime = tmp_path / f"sweepctl-{os.getuid()}"  # the user's socket folder must be empty
    assert not runtime.exists() or not list(runtime.iterdir())
    left = {p.name for p in tmp_path.iterdir()}
    assert left <= {"bin", "out", runtime.name}, f"left behind: {left}"


def test_a_script_whose_emulator_cannot_start_fails(tmp_path: Path) -> None:
    environment = with_sweepctl(tmp_path)
    (tmp_path / "bin" / "sweepctl").write_text("#!/bin/sh\necho no; exit 3\n")
    done = subprocess.run(
        [BASH, EXAMPLES / "emulated-run.sh", tmp_path],
        env=environment,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode != 0
    assert "done" not in done.stdout


def test_the_users_test_passes(tmp_path: Path) -> None:
    file = tmp_path / "test_my_controller.py"
    file.write_text((EXAMPLES / file.name).read_text())
    plugin = [] if entry_points(group="pytest11", name="sweepctl") else ["-p", "sweepctl_pytest"]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", *plugin, "-p", "no:cacheprovider", file.name],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    assert "4 passed" in done.stdout


# ---- the workflow -----------------------------------------------------------------------


def steps_of(text: str) -> list[dict[str, Any]]:
    """Return the steps of the only job, parsed by indentation without a YAML library."""
    steps: list[dict[str, Any]] = []
    body = text[text.index("    steps:\n") + len("    steps:\n") :]
    for block in re.split(r"^      - ", body, flags=re.MULTILINE)[1:]:
        step: dict[str, Any] = {}
        lines = block.splitlines()
        for number, line in enumerate(lines):
            found = re.match(r"(?:        )?(name|uses|run|if): ?(.*)$", line)
            if found and (number == 0 or line.startswith("        " + found[1])):
                value = found[2]
                if value == "|":
                    kept = []
                    for more in lines[number + 1 :]:
                        if not more.startswith("          "):
                            break
                        kept.append(more[10:])
                    value = "\n".join(kept)
                step[found[1]] = value
        steps.append(step)
    return steps


def commands(lines: str, name: str) -> list[list[str]]:
    """Return the words of each command line that starts with ``name``, without redirections."""
    joined = lines.replace("\\\n", " ")
    found = [shlex.split(line, comments=True) for line in joined.splitlines() if name in line]
    cut = []
    for words in found:
        if name in words:
            rest = words[words.index(name) :]
            ends = [i for i, w in enumerate(rest) if w.startswith((">", "|", "&", "3<", ")"))]
            cut.append(rest[: min(ends, default=len(rest))])
    return cut


def check_command(words: list[str]) -> None:
    """Check that a ``sweepctl`` command line names an existing command and options."""
    context = click.Context(cli)
    command = cli.get_command(context, words[1])
    assert command is not None, f"no command {words[1]}"
    known = {option for p in command.params for option in (*p.opts, *p.secondary_opts)}
    for word in words[2:]:
        if word.startswith("--"):
            assert word.partition("=")[0] in known, f"{words[1]} has no {word}"


def test_the_workflow_names_existing_commands() -> None:
    text = (EXAMPLES / "github-actions.yml").read_text()
    assert "\t" not in text
    steps = steps_of(text)
    assert len(steps) == text.count("\n      - ")
    assert all(("uses" in step) != ("run" in step) for step in steps)
    assert all(re.fullmatch(r"[\w-]+/[\w-]+@v\d+", s["uses"]) for s in steps if "uses" in s)
    runs = [step["run"] for step in steps if "run" in step]
    reported = [words for run in runs for words in commands(run, "sweepctl")]
    assert [words[1] for words in reported if words[0] == "sweepctl" and len(words) > 2] == [
        "simulate"
    ]
    for words in reported:
        if len(words) > 2:
            check_command(words)
    for run in runs:
        for file in re.findall(r"\S+\.(?:sh|py)\b", run):
            assert (EXAMPLES / file).is_file(), f"{file} is not beside the workflow"
    assert any("emulated-run.sh" in run for run in runs)
    assert any("test_my_controller.py" in run for run in runs)


def test_the_workflows_figure_holds() -> None:
    """Its step with a figure passes on a good summary, and fails on a bad one."""
    text = (EXAMPLES / "github-actions.yml").read_text()
    (run,) = [s["run"] for s in steps_of(text) if "simulate" in s.get("run", "")]
    ((_, _, program),) = commands(run, "python")

    def verdict(coverage: float, outcome: str) -> int:
        summary = {"outcome": outcome, "coverage": {"mouth_sweepable": coverage}}
        fed = program.replace(
            "open('clean.json')", f"__import__('io').StringIO({json.dumps(json.dumps(summary))})"
        )
        return subprocess.run(
            [sys.executable, "-c", fed], check=False, capture_output=True
        ).returncode

    assert verdict(0.9, "complete") == 0
    assert verdict(0.5, "complete") == 1
    assert verdict(0.9, "timeout") == 1


def test_the_script_names_existing_commands() -> None:
    found = commands((EXAMPLES / "emulated-run.sh").read_text(), "sweepctl")
    reported = [words for words in found if len(words) > 2]
    assert [words[1] for words in reported] == ["emulate", "connect", "fault"]
    for words in reported:
        check_command([w for w in words if w != ")"])
    assert "sleep " not in (EXAMPLES / "emulated-run.sh").read_text().replace("no sleep,", "")


@pytest.mark.parametrize("link", re.findall(r"\]\(([^)#]+)\)", PAGE.read_text()))
def test_the_page_links_exist(link: str) -> None:
    assert (PAGE.parent / link).exists(), link


def test_the_page_shows_the_example_unchanged() -> None:
    codes = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert len(codes) == 2
    example = (EXAMPLES / "test_my_controller.py").read_text()
    without_types = re.sub(
        r"(: [\w.| ]+)(?=[,)])|(\) -> [^:]+)(?=:)", lambda m: ")" if m[2] else "", example
    )
    squeezed = re.sub(r"\s+", "", without_types)
    for block in "\n\n".join(codes).split("\n\n"):
        lines = [line for line in block.splitlines() if line.strip() and '"""' not in line]
        for line in lines:
            assert re.sub(r"\s+", "", line) in squeezed, line
