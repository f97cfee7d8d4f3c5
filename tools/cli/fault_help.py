"""Faults for people and for logs: the list, its page in the docs, and the record of an event."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from sim_device.faults.kinds import KINDS, as_dict
from sim_device.faults.spec import Number
from tools.cli.console import write_json, write_lines

if TYPE_CHECKING:
    from bridge.session.records import EventRecord
    from sim_device.faults.injector import FaultEvent
    from sim_device.faults.spec import Argument, FaultKind

GRAMMAR = "kind@time[:for][:name=value,...]"


def print_faults(*, as_json: bool) -> None:
    """Every kind on stdout."""
    if as_json:
        write_json({"faults": [as_dict(kind) for kind in KINDS.values()]})
        return
    lines = [
        f"--fault {GRAMMAR}",
        "",
        "Times are seconds since the device was switched on (also 500ms, 2s). Without a duration",
        "a fault lasts until the end. Faults may overlap: their effects add up.",
        "",
    ]
    for kind in KINDS.values():
        lines += [kind.name, *_wrapped(kind.meaning)]
        lines += [line for a in kind.arguments for line in _wrapped(_argument(a))]
        lines += [f"    {_lasts(kind)}  --fault {kind.example}", ""]
    write_lines("\n".join(lines))


def _wrapped(text: str) -> list[str]:
    return click.wrap_text(text, 96, "    ", "      ").splitlines()


def _argument(argument: Argument) -> str:
    default = f"{argument.default:g}" if isinstance(argument, Number) else argument.default
    return f"{argument.name}: {argument.meaning}; {argument.allowed}, default {default}."


def _lasts(kind: FaultKind) -> str:
    return "Lasts." if kind.lasting else "Over at once."


def faults_page() -> str:
    """``docs/faults.md``."""
    rows = []
    for kind in KINDS.values():
        arguments = "<br>".join(_cell(a) for a in kind.arguments)
        lasts = "lasts" if kind.lasting else "at once"
        rows.append(
            f"| `{kind.name}` | {kind.meaning} | {lasts} | {arguments} | `{kind.example}` |"
        )
    return _PAGE.replace("@ROWS@", "\n".join(rows))


def _cell(argument: Argument) -> str:
    default = f"{argument.default:g}" if isinstance(argument, Number) else argument.default
    return f"`{argument.name}` = {default}: {argument.meaning} ({argument.allowed})"


def fault_record(event: FaultEvent, log_ns: int) -> EventRecord:
    """A fault's beginning or end, for the log's ``/events``."""
    from bridge.session.records import EventRecord, Severity

    data: dict[str, float | str] = {
        "fault": event.spec.kind.name,
        "what": event.what,
        "spec": event.spec.text,
        "device_time_s": event.t_us / 1e6,
        **event.spec.values,
    }
    return EventRecord(log_ns, Severity.WARNING, "fault", event.what, event.text, data)


_PAGE = f"""\
# Faults of the virtual sweeper

<!-- Written by `python -m tools.cli.fault_help`; a test holds it fresh. -->

`sweepctl emulate` and `sweepctl simulate` take `--fault {GRAMMAR}` any number
of times. `sweepctl emulate --list-faults` prints this list, with `--json` as one object.

- Times are seconds since the device was switched on (`500ms` and `2s` are understood too).
  A fault without a duration lasts until the end of the run.
- Values may stand without their names, in the order below: `wheel-stuck@20:3:left`.
- Faults compose. Shares of the same kind come together as independent chances
  (1 − (1 − a)(1 − b)), biases, delays and moves add up, and the end of one fault never ends
  another.
- All is seeded by `--seed`: in `simulate` the same seed and faults give the same bytes. A share
  is a chance per byte; what is drawn is the gap to the next hit, so it does not matter how
  bytes are cut into pieces.
- A text that cannot be used ends the command with status 2 and one line.

```sh
sweepctl simulate case-1 --fault wheel-slip@20:5:share=0.4 --fault bit-flips@0:rate=1e-5
sweepctl emulate case-1 --pty-link /tmp/sweeper --fault unplug@30:4
```

## While it runs

```sh
sweepctl emulate case-1 --pty-link /tmp/sweeper --control /tmp/sweeper.ctl &
sweepctl fault /tmp/sweeper.ctl silence:0.5 person:10:ahead=0.6
sweepctl fault /tmp/sweeper.ctl --list
sweepctl fault /tmp/sweeper.ctl --clear person
```

Without `@time` a fault begins at once; `@+2` is in two seconds. The control socket is a Unix
socket with mode 0600; it takes lines (`start SPEC`, `clear [KIND]`, `list`, `truth`, `line`) and
answers each with a line of JSON. In Python: `rig.faults.start("silence:0.5")`,
`rig.faults.clear("silence")`, with `sim_device.rig.Rig`.

What was injected is on record: in a log of `simulate`, and in the file of `emulate --truth`,
each beginning and end is an event of source `fault` on `/events`, with the fault's text, its
values and the device's time.

## Kinds

| kind | what happens | duration | arguments and defaults | example |
|---|---|---|---|---|
@ROWS@

## The line itself

Without any fault the line is a real one. `emulate` paces bytes at `--baud` (default 921 600;
10 bits a byte), and hands them to the host as a USB adapter does: when 62 are there, or when its
timer fires (`--latency-ms`, default 1; an FTDI adapter that nobody told otherwise has 16).
`--baud 0` takes both away. In `simulate` a delay of 1 ms each way stands for all of it, unless
`--baud` or `--latency-ms` asks for the model.

Buffers have ends. The device's transmit buffer holds 4096 B: at a rate that is too low for its
streams (4.9 kB/s: below about 50 000 baud) bytes are lost there. The adapter's holds 4096 B for
a host that does not read; behind it, on a pseudo-terminal, the kernel holds some thousand more.
What was lost is said at the end. Towards the device nothing is lost: USB holds the host back.

A pseudo-terminal has no baud rate: a host that opens it at another rate than `--baud` is
understood all the same. `wrong-baud` is what it would get on a wire.

On CAN the faults of the line act on frames. Its controllers find damage by themselves, so
`bit-flips` and `bursts` cost time, `byte-loss` loses and `duplicates` doubles a whole frame,
and with `wrong-baud` no frame ever passes.
"""


if __name__ == "__main__":
    write_lines(faults_page())
