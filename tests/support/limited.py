"""Runs log commands with limited memory on some files of a group.

``python -m support.limited GROUP FOLDER FILES`` prints the results as JSON.
"""

from __future__ import annotations

import json
import os
import re
import resource
import sys
import traceback
from pathlib import Path

from support.hostile_logs import GROUPS

MEMORY = 5 << 29
"""Address space of a command, bytes: 2.5 GiB, of which the libraries need about 1.2 GiB."""
CPU_S = 100
"""Maximum processor time of a command, s: many times its usual time. Without a limit, the files
would take hours.
"""
COMMANDS = {
    "info": ("info", "FILE", "--json"),
    "recover": ("recover", "FILE", "--out", "OUT.mcap"),
    "export": ("export", "FILE", "--out", "OUT"),
    "doctor": ("doctor", "FILE"),
    "check": ("replay", "FILE", "--check"),
    "replay": ("replay", "FILE", "--link", "pty"),
    "diff": ("diff", "FILE", "FILE", "--json"),
    "report": ("report", "FILE", "--out", "OUT.html"),
    "picture": ("view", "FILE", "--png", "OUT.png"),
    "rerun": ("view", "FILE", "--save", "OUT.rrd"),
}
DRAWING = {"report", "picture", "rerun"}
"""Commands that read a file as ``diff`` does, and need seconds to draw it. They run on all files of
the groups in ``DRAWN``, but only on the first file of every other group.
"""
DRAWN = {"contents", "impostors"}


def main() -> None:
    """Run each command on each file in a separate process; print the result of each command."""
    from tools.cli.main import run  # noqa: F401, PLC0415 - as above

    group, folder, files = sys.argv[1], Path(sys.argv[2]), int(sys.argv[3])
    done: dict[str, dict[str, object]] = {}
    for number, (name, data) in enumerate([*GROUPS[group]().items()][:files]):
        file = folder / (re.sub(r"\W+", "-", name) + ".mcap")
        file.write_bytes(data)
        for command, words in COMMANDS.items():
            if command in DRAWING and group not in DRAWN and (number or files == 1):
                continue
            out = folder / f"{file.stem}-{command}"
            arguments = [str(file) if w == "FILE" else w.replace("OUT", str(out)) for w in words]
            printed = folder / "said"
            child = os.fork()
            if not child:
                _run(arguments, printed)
            _, status, used = os.wait4(child, 0)
            done[f"{name}: {command}"] = {
                "status": os.waitstatus_to_exitcode(status),
                "cpu_s": round(used.ru_utime + used.ru_stime, 1),
                "memory_mib": used.ru_maxrss >> 10,
                "said": printed.read_text(errors="replace")[-1500:],
            }
    json.dump(done, sys.stdout)


def _run(arguments: list[str], printed: Path) -> None:
    """Run a command in the child process and write its output to a file."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S))
    number = os.open(printed, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(number, 1)
    os.dup2(number, 2)
    status = 99
    try:
        from tools.cli.main import run  # noqa: PLC0415 - loaded by the parent

        status = run(arguments)
    except BaseException:  # noqa: BLE001 - any exception is the subject of the test
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


if __name__ == "__main__":
    main()
