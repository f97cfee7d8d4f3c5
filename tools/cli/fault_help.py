"""Faults as text: the list of kinds, the page ``docs/faults.md``, and the event in a log."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from sim_device.faults.kinds import KINDS, OWN_KINDS, as_dict
from sim_device.faults.spec import Number
from tools.cli.console import write_json, write_lines

if TYPE_CHECKING:
    from bridge.session.records import EventRecord
    from sim_device.faults.injector import FaultEvent
    from sim_device.faults.spec import Argument, FaultKind

GRAMMAR = "kind@time[:for][:name=value,...]"


def print_faults(*, as_json: bool) -> None:
    """Print every kind of fault on stdout."""
    if as_json:
        write_json({"faults": [as_dict(kind) for kind in KINDS.values()]})
        return
    lines = [
        f"--fault {GRAMMAR}",
        "",
        "Times are seconds since the device was switched on (500ms and 2s work too). A fault",
        "without a duration lasts until the end. Faults can overlap: their effects combine.",
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
    return "Lasts." if kind.lasting else "At once."


def faults_page() -> str:
    """Return the page ``docs/faults.md``."""
    kinds, arguments = [], []
    for kind in OWN_KINDS.values():
        lasts = "lasts" if kind.lasting else "at once"
        kinds.append(f"| `{kind.name}` | {kind.meaning} | {lasts} | `{kind.example}` |")
        arguments += [_argument_row(kind, argument) for argument in kind.arguments]
    page = _PAGE.replace("@KINDS@", "\n".join(kinds))
    return page.replace("@ARGUMENTS@", "\n".join(arguments))


def _argument_row(kind: FaultKind, argument: Argument) -> str:
    default = f"{argument.default:g}" if isinstance(argument, Number) else argument.default
    name = f"`{kind.name}` | `{argument.name}`"
    return f"| {name} | {default} | {argument.allowed} | {argument.meaning} |"


def fault_record(event: FaultEvent, log_ns: int) -> EventRecord:
    """Return the beginning or end of a fault as a record for ``/events``."""
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

How to inject faults into the virtual sweeper, and every kind of fault.

`sweepctl emulate` and `sweepctl simulate` accept `--fault {GRAMMAR}`
any number of times. `sweepctl emulate --list-faults` prints this list, with `--json` as one object.

- Times are seconds since the device was switched on (`500ms` and `2s` work too). A fault without a
  duration lasts until the end of the run.
- Values can be given without names, in the order below: `wheel-stuck@20:3:left`.
- Faults combine. Shares of the same kind combine as independent probabilities
  (1 − (1 − a)(1 − b)). Biases, delays and moves add up. The end of one fault never ends another.
- `--seed` determines everything random. In `simulate` the same seed and faults give the same bytes.
  A share is a probability per byte, and does not depend on how the bytes are split.
- An invalid text ends the command with status 2 and one line.

```sh
sweepctl simulate case-1 --fault wheel-slip@20:5:share=0.4 --fault bit-flips@0:rate=1e-5
sweepctl emulate case-1 --pty-link /tmp/sweeper --fault unplug@30:4
```

## During a run

```sh
sweepctl emulate case-1 --pty-link /tmp/sweeper --control /tmp/sweeper.ctl &
sweepctl fault /tmp/sweeper.ctl silence:0.5 person:10:ahead=0.6
sweepctl fault /tmp/sweeper.ctl --list
sweepctl fault /tmp/sweeper.ctl --clear person
sweepctl fault /tmp/sweeper.ctl --truth      # the true pose, path, collisions and energy
```

Without `@time` a fault begins at once; `@+2` means in two seconds. The control socket is a Unix
socket with mode 0600. It accepts lines (`start SPEC`, `check SPEC`, `clear [KIND]`, `list`,
`truth`, `line`) and answers each with a line of JSON. In Python use
`rig.faults.start("silence:0.5")` and `rig.faults.clear("silence")` of `sim_device.rig.Rig`.

Injected faults are recorded in a log of `simulate` and in the file of `emulate --truth`. Each
beginning and each end is an event of source `fault` on `/events`, with the text of the fault, its
values and the device's time.

## Kinds

| kind | effect | duration | example |
|---|---|---|---|
@KINDS@

## Arguments

| kind | argument | default | values | meaning |
|---|---|---|---|---|
@ARGUMENTS@

## The link without faults

`emulate` sends bytes at the rate of `--baud` (default 921 600; 10 bits a byte). It delivers them to
the host as a USB adapter does: after 62 bytes, or when a timer expires (`--latency-ms`, default 1;
an FTDI adapter has 16 by default). `--baud 0` turns both off. `simulate` uses a delay of 1 ms in
each direction, unless `--baud` or `--latency-ms` selects this model.

Buffers are finite. The device's transmit buffer holds 4096 B. At a rate too low for its streams
(4.9 kB/s, below about 50 000 baud) it loses bytes. The adapter's buffer holds 4096 B for a host
that does not read, and the kernel some thousand more on a pseudo-terminal. The number of lost bytes
is printed at the end. Towards the device nothing is lost, because USB holds the host back.

A pseudo-terminal has no baud rate: a host that opens it at another rate than `--baud` still works.
`wrong-baud` simulates the mismatch.

On CAN the faults act on frames. The controllers detect damage and repeat the frame, so `bit-flips`
and `bursts` cost time. `byte-loss` loses a whole frame, `duplicates` duplicates one, and with
`wrong-baud` no frame passes.
"""


if __name__ == "__main__":
    write_lines(faults_page())
