"""Authentication in the C firmware: published vectors, comparison with Python, and sessions."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from protocol.authentication import Authenticator, covered_can, key_words
from protocol.can.link import CanLink
from protocol.messages.device import Challenge, Hello, Nack
from protocol.messages.host import (
    ClearStop,
    HostHello,
    SaveParameters,
    SetKey,
    SetMode,
    SetParameter,
    TimeRequest,
    VelocitySetpoint,
)
from protocol.messages.values import Capability, Mode, NackReason, StopCause
from protocol.schema.message import Direction
from protocol.uart.link import Link
from support.c_build import C_TESTS, MORE, STRICT, any_compiler, run
from support.core_build import FIRMWARE, script_board, wire
from support.script_format import Boot, Readings, Step, received

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from protocol.link import LinkBase
    from protocol.schema.message import Message
    from support.script_format import Act

pytestmark = pytest.mark.slow

KEY = bytes(range(0x10, 0x20))
SESSION = 7
VELOCITY_STATE = 2
"""``STATE_VELOCITY`` of ``core/modes.h``."""
HOST_AHEAD_US = 5_000_000


@pytest.fixture(scope="module")
def ask(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Sequence[str]], list[str]]:
    folder = tmp_path_factory.mktemp("authentication")
    program = folder / "authentication"
    core = [FIRMWARE / "core" / name for name in ("authentication.c", "sha256.c")]
    compiler = any_compiler("gcc", "clang")
    includes = (f"-I{FIRMWARE / 'core'}", f"-I{wire(folder)}")
    flags = (*STRICT, *MORE, "-g", *compiler.sanitized)
    compiler.run(*flags, *includes, "-o", program, C_TESTS / "authentication.c", *core)

    def asked(lines: Sequence[str]) -> list[str]:
        return run([program], data="".join(f"{line}\n" for line in lines).encode()).decode().split()

    return asked


def shown(data: bytes) -> str:
    return data.hex() or "-"


# ---- vectors -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("message", "digest"),
    [  # NIST's examples for FIPS 180-4, and lengths near the end of a block
        (b"abc", "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"),
        (b"", "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"),
        (
            b"abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq",
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1",
        ),
        (b"a" * 1000, "41edece42d63e8d9bf515a9ba6932e1c20cbc9f5a5d134645adb5db1b9737ea3"),
    ],
)
def test_sha_256(ask: Callable[[Sequence[str]], list[str]], message: bytes, digest: str) -> None:
    assert ask([f"hash {shown(message)}"]) == [digest]


@pytest.mark.parametrize(
    ("key", "message", "digest"),
    [  # RFC 4231, test cases 1 to 4, whose keys fit into one block
        (
            b"\x0b" * 20,
            b"Hi There",
            "b0344c61d8db38535ca8afceaf0bf12b881dc200c9833da726e9376c2e32cff7",
        ),
        (
            b"Jefe",
            b"what do ya want for nothing?",
            "5bdcc146bf60754e6a042426089575c75a003f089d2739839dec58b964ec3843",
        ),
        (
            b"\xaa" * 20,
            b"\xdd" * 50,
            "773ea91e36800e46854db8ebd09181a72959098b3ef8c122d9635514ced565fe",
        ),
        (
            bytes(range(1, 26)),
            b"\xcd" * 50,
            "82558a389a443c0ea4cc819899f2083a85f0faa3e578f8077a2e3ff46729665b",
        ),
    ],
)
def test_hmac(
    ask: Callable[[Sequence[str]], list[str]], key: bytes, message: bytes, digest: str
) -> None:
    assert ask([f"hmac {key.hex()} {message.hex()}"]) == [digest]


# ---- comparison with Python -----------------------------------------------------------------


def test_the_same_frames_are_taken(ask: Callable[[Sequence[str]], list[str]]) -> None:
    """Cases are valid, changed, replayed, reordered and foreign frames, on UART and CAN."""
    rng = random.Random(4)
    host, device = Authenticator(KEY), Authenticator(KEY)
    lines = ["key " + " ".join(f"{word:x}" for word in key_words(KEY))]
    expected = ["ok"]
    trailers: list[tuple[bytes, bytes]] = []
    opened = 0
    for turn in range(400):
        if turn % 100 == 0:
            opened += 1
            boot_id, session_id = rng.randrange(1 << 32), rng.randrange(1 << 32)
            challenge = device.challenge(boot_id, session_id, opened)
            host.begin(boot_id, session_id, challenge)
            device.begin(boot_id, session_id, challenge)
            lines.append(f"open {boot_id:x} {session_id:x}")
            expected.append(f"{challenge:x}")
        can = rng.random() < 0.5
        data = rng.randbytes(rng.randrange(1, 40))
        frames = [(rng.randrange(0x800), data)]
        covered = covered_can(frames) if can else data
        trailer = host.sign_can(frames) if can else host.sign(data)
        trailers.append((covered, trailer))
        match rng.randrange(6):
            case 0:
                at = rng.randrange(len(trailer))
                trailer = (
                    trailer[:at] + bytes([trailer[at] ^ 1 << rng.randrange(8)]) + trailer[at + 1 :]
                )
            case 1:
                covered, trailer = rng.choice(trailers)
            case 2:
                covered += b"x"
            case _:
                pass
        taken = (
            device.check(covered, trailer)
            if len(trailer) == 12
            else _check_can(device, covered, trailer)
        )
        lines.append(f"check {covered.hex()} {trailer.hex()}")
        expected.append(str(int(taken)))
    assert expected.count("1") > 150
    assert expected.count("0") > 80
    assert ask(lines) == expected


def _check_can(device: Authenticator, covered: bytes, trailer: bytes) -> bool:
    identifier, length = int.from_bytes(covered[:2], "little"), covered[2]
    frames = [(identifier, covered[3 : 3 + length])]
    if covered_can(frames) != covered:
        return False
    return device.check_can(frames, trailer)


# ---- in sessions ----------------------------------------------------------------------------


class Host:
    """Writes the frames of a host that may know the key."""

    def __init__(self, link: LinkBase, key: bytes | None, boot_id: int) -> None:
        self.acts: list[Act] = []
        self.boot_id = boot_id
        self.link = link
        self._key = None if key is None else Authenticator(key)
        self.counter = 0
        self.now_us = 0

    def sign_from(self, openings: int) -> None:
        """Set the device's challenge, which follows from the key."""
        assert self._key is not None
        challenge = self._key.challenge(self.boot_id, SESSION, openings)
        self._key.begin(self.boot_id, SESSION, challenge)
        self.link.key = self._key

    def send(self, *messages: Message, after_us: int = 20_000) -> bytes:
        self.now_us += after_us
        for message in messages:
            self.link.send(message, self.now_us + HOST_AHEAD_US, node=1)
        data = self.link.data_to_send()
        self.acts.append(Step(after_us, data))
        return data

    def raw(self, data: bytes) -> None:
        self.acts.append(Step(20_000, data))
        self.now_us += 20_000

    def drive(self) -> bytes:
        self.counter += 1
        return self.send(VelocitySetpoint(1500, 0, 200, self.counter))

    def handshake(self) -> None:
        self.greet(negotiated=0)
        self.greet()

    def greet(self, *, negotiated: int = 1) -> None:
        self.send(HostHello(0, SESSION, self.boot_id, negotiated, "host"))


def keyed_by_uart() -> list[Act]:
    """Set a key over the serial link; it is stored after the quarter of a second of a save."""
    host = Host(Link(Direction.HOST), None, 1)
    host.handshake()
    host.send(SetKey(1, *key_words(KEY)))
    for _ in range(20):
        host.greet()
    return [Readings(), Boot(boot_id=1), *host.acts]


@pytest.mark.parametrize("can", [False, True], ids=["uart", "can"])
def test_a_session_with_a_key(can: bool) -> None:  # noqa: FBT001 - a parameter of the test
    """Signed frames drive; unsigned, replayed or changed frames move nothing."""
    kind = CanLink if can else Link
    host = Host(kind(Direction.HOST), KEY, 2)
    host.handshake()
    host.sign_from(1)
    host.send(ClearStop(1, StopCause.SESSION_END))
    host.send(SetMode(2, Mode.VELOCITY))
    for _ in range(5):
        host.drive()
    last = host.drive()
    signed = len(host.acts)
    host.raw(last)
    host.link.key = None
    host.drive()
    host.send(SetMode(3, Mode.IDLE))
    for _ in range(3):
        host.greet()
    before = [*keyed_by_uart(), Boot(boot_id=2, can=can, empty_flash=False)]
    reports = script_board().run([*before, *host.acts])[-len(host.acts) :]
    driving = reports[signed - 1]
    assert driving.state == VELOCITY_STATE
    assert driving.motors[0] > 1000
    assert driving.stale == 0
    final = reports[-1]
    assert final.stale == 1, "of the unsigned one; what is played back is no frame of the session"
    assert final.state == VELOCITY_STATE, "no unsigned command changes the mode"
    said = received(reports, kind(Direction.HOST))
    assert any(isinstance(r.message, Challenge) for r in said)
    rejections = [r.message for r in said if isinstance(r.message, Nack)]
    assert [nack.reason for nack in rejections] == [NackReason.NOT_AUTHENTICATED]
    hello = next(r.message for r in said if isinstance(r.message, Hello) and r.message.session_id)
    assert Capability(hello.capabilities) & Capability.AUTHENTICATION


def test_a_key_is_set_beside_the_parameters_and_removed_with_its_tag() -> None:
    """A key outlives a save of the parameters. Only a tagged command removes it."""
    host = Host(Link(Direction.HOST), KEY, 2)
    host.handshake()
    host.send(SetKey(1, 0, 0, 0, 0))  # without a tag
    host.sign_from(1)
    host.send(ClearStop(2, StopCause.SESSION_END))
    host.send(SetParameter(3, 6, 2, 0x3E19999A))  # cruise_speed 0.15
    host.send(SaveParameters(4))
    for _ in range(20):
        host.greet()
    after = Host(Link(Direction.HOST), KEY, 3)
    after.handshake()
    after.sign_from(1)
    after.send(SetKey(5, 0, 0, 0, 0))
    for _ in range(20):
        after.greet()
    acts = [*keyed_by_uart(), Boot(boot_id=2, empty_flash=False), *host.acts]
    acts += [Boot(boot_id=3, empty_flash=False), *after.acts]
    reports = script_board().run(acts)
    first, second = reports[-len(after.acts) - len(host.acts) :], reports[-len(after.acts) :]
    rejections = [
        r.message for r in received(first, Link(Direction.HOST)) if isinstance(r.message, Nack)
    ]
    assert [(n.command_id, n.reason) for n in rejections] == [(1, NackReason.NOT_AUTHENTICATED)]
    hellos = [
        r.message for r in received(second, Link(Direction.HOST)) if isinstance(r.message, Hello)
    ]
    keyed = [bool(Capability(h.capabilities) & Capability.AUTHENTICATION) for h in hellos]
    assert keyed[0], "saved beside the parameters"
    assert not keyed[-1]
    assert second[-1].parameters[6] == 0x3E19999A


@pytest.mark.parametrize("signs", [False, True])
def test_only_signed_frames_keep_a_session_alive(signs: bool) -> None:  # noqa: FBT001 - a parameter of the test
    """Anyone can send hellos; only the host can send a signed time request."""
    host = Host(Link(Direction.HOST), KEY, 2)
    host.handshake()
    host.sign_from(1)
    host.send(ClearStop(1, StopCause.SESSION_END))
    for ping in range(60):
        if signs:
            host.send(TimeRequest(ping))
        else:
            host.greet()
    acts = [*keyed_by_uart(), Boot(boot_id=2, empty_flash=False), *host.acts]
    final = script_board().run(acts)[-1]
    assert final.stop_cause == (StopCause.NONE if signs else StopCause.LINK)
