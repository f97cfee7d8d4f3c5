"""A chip in QEMU that a test controls as a debugger does, with gdb's remote protocol."""

from __future__ import annotations

import os
import socket
import subprocess
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from sim_device.ports.qemu_process import MACHINE
from support.c_build import run, tool

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

ANSWER_S = 30.0
"""Time limit of an answer, s: far more than the start of the program needs."""
_R0, _SP, _LR, _PC, _XPSR = 0, 13, 14, 15, 25
_EXCEPTION = 0x1FF
_STR_R1_R0 = 0x6001
"""The instruction ``str r1, [r0]``."""


class Debugger:
    """A debugger that is connected to a halted chip."""

    def __init__(self, stub: socket.socket, symbols: dict[str, int]) -> None:
        stub.settimeout(ANSWER_S)
        self._stub = stub
        self.symbols = symbols
        self._command("qXfer:features:read:target.xml:0,fff")  # QEMU then allows `p` and `P`

    def word(self, address: int) -> int:
        """Return a word of memory, or a register of a peripheral."""
        return self.words(address, 1)[0]

    def words(self, address: int, count: int) -> list[int]:
        """Return consecutive words."""
        data = bytes.fromhex(self._command(f"m{address:x},{4 * count:x}"))
        return [int.from_bytes(data[i : i + 4], "little") for i in range(0, len(data), 4)]

    def store(self, address: int, value: int) -> None:
        """Let the chip store a word: a debugger's own writes do not reach QEMU's peripherals."""
        place = self.symbols["ld_stack_bottom"]
        self._change(f"M{place:x},2:{_STR_R1_R0.to_bytes(2, 'little').hex()}")
        before = {number: self._register(number) for number in (0, 1, _PC)}
        for number, content in ((0, address), (1, value), (_PC, place)):
            self._set_register(number, content)
        while self._register(_PC) == place:  # QEMU sometimes stops before the instruction
            stopped = self._command("s")
            assert stopped.startswith("T05"), stopped
        assert self._register(_PC) == place + 2
        for number, content in before.items():
            self._set_register(number, content)

    @property
    def stack_pointer(self) -> int:
        """The stack pointer."""
        return self._register(_SP)

    @stack_pointer.setter
    def stack_pointer(self, value: int) -> None:
        self._set_register(_SP, value)

    @property
    def exception(self) -> int:
        """The number of the exception whose handler runs; 0: none."""
        return self._register(_XPSR) & _EXCEPTION

    def start_without_reset(self) -> None:
        """Let the program continue at its entry, as after gdb's ``load``."""
        self._set_register(_PC, self.symbols["reset_handler"])

    def run_to(self, function: str, *, never: Sequence[str] = ()) -> None:
        """Let the chip run until it enters the function, and never one of the others."""
        breakpoints = {self.symbols[name]: name for name in (function, *never)}
        for address in breakpoints:
            self._change(f"Z0,{address:x},2")
        stopped = self._command("c")
        assert stopped.startswith("T05"), stopped
        assert breakpoints[self._register(_PC)] == function
        for address in breakpoints:
            self._change(f"z0,{address:x},2")

    def result_of(self, function: str) -> int:
        """Let the chip run until the function has returned; return its result."""
        self.run_to(function)
        caller = self._register(_LR) & ~1
        self._change(f"Z0,{caller:x},2")
        stopped = self._command("c")
        assert stopped.startswith("T05"), stopped
        assert self._register(_PC) == caller
        self._change(f"z0,{caller:x},2")
        return self._register(_R0)

    def _register(self, number: int) -> int:
        return int.from_bytes(bytes.fromhex(self._command(f"p{number:x}")), "little")

    def _set_register(self, number: int, value: int) -> None:
        self._change(f"P{number:x}={value.to_bytes(4, 'little').hex()}")

    def _change(self, packet: str) -> None:
        answer = self._command(packet)
        assert answer == "OK", (packet, answer)

    def _command(self, packet: str) -> str:
        body = packet.encode("ascii")
        self._stub.sendall(b"$" + body + b"#%02x" % (sum(body) % 256))
        received = b""
        while b"#" not in received[:-2]:
            try:
                chunk = self._stub.recv(4096)
            except TimeoutError:
                pytest.fail(f"no answer to {packet}, only {received!r}")
            assert chunk, f"QEMU has ended: {packet}"
            received += chunk
        self._stub.sendall(b"+")
        return received.partition(b"$")[2].rpartition(b"#")[0].decode("ascii")


@contextmanager
def halted_chip(firmware: Path, unemulated: Path = Path(os.devnull)) -> Iterator[Debugger]:
    """Emulate the chip during the block. It is halted before the first instruction.

    QEMU writes each access to a peripheral that it does not emulate to the file ``unemulated``.
    """
    names = run([tool("arm-none-eabi-nm"), firmware]).decode().splitlines()
    symbols = {name: int(address, 16) for address, _, name in map(str.split, names)}
    ours, theirs = socket.socketpair()
    with ours:
        with theirs:
            number = theirs.fileno()
            process = subprocess.Popen(
                [
                    *(tool("qemu-system-arm"), "-M", MACHINE, "-nodefaults", "-display", "none"),
                    *("-serial", "null", "-serial", "null", "-kernel", firmware, "-S"),
                    *("-d", "unimp", "-D", unemulated),
                    *("-chardev", f"socket,id=gdb,fd={number}", "-gdb", "chardev:gdb"),
                ],
                stdin=subprocess.DEVNULL,
                pass_fds=[number],
            )
        try:
            yield Debugger(ours, symbols)
        finally:
            process.kill()
            process.wait()
