"""The device answers every command, rejects with a reason, and executes each command once."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.messages.device import Ack, Nack
from protocol.messages.host import (
    ClearStop,
    GetParameter,
    Reboot,
    SaveParameters,
    SetMode,
    SetParameter,
    SetStreamRate,
)
from protocol.messages.values import Mode, NackReason, StopCause
from protocol.schema.catalogue import CATALOGUE

if TYPE_CHECKING:
    from protocol.schema.message import Message
    from support.probe import Probe

OPERATOR = StopCause.OPERATOR
REMEMBERED = 16


def type_of(message: Message) -> int:
    return CATALOGUE.by_class[type(message)].type_id


def again(device: Probe, message: Message, command_id: int) -> list[Ack | Nack]:
    """Repeat a command exactly; return every answer to it."""
    mark = len(device.received)
    device.send(message)
    device.until(lambda: bool(device.replies(command_id, type_of(message), mark)), 0.5)
    device.ping()  # any second answer has arrived by now
    return device.replies(command_id, type_of(message), mark)


def test_an_answer_names_the_command(device: Probe) -> None:
    device.handshake()
    first = device.next_id()
    for ahead in (0, 1, 0x1234, 0x7FFF, 0xEDCC, 0xFFFF):  # ids count up, and wrap
        command_id = (first + ahead) & 0xFFFF
        message = SetMode(command_id, Mode.IDLE)
        reply = device.reply_to(message)
        assert reply == Ack(command_id, type_of(message))


def test_one_command_has_one_answer(device: Probe) -> None:
    device.handshake()
    command_id = device.next_id()
    mark = len(device.received)
    device.send(SetMode(command_id, Mode.IDLE))
    device.listen(0.4)
    assert len(device.replies(command_id, 0x06, mark)) == 1


def test_before_the_handshake_everything_but_stop_is_rejected(device: Probe) -> None:
    device.handshake()
    device.stop()
    device.greet()
    commands = (
        lambda i: ClearStop(i, OPERATOR),
        lambda i: SetMode(i, Mode.IDLE),
        lambda i: GetParameter(i, 0),
        lambda i: SetParameter(i, 0, 0, 1),
        SaveParameters,
        lambda i: SetStreamRate(i, 0x13, 10),
        lambda i: Reboot(i, 0),
    )
    for make in commands:
        message = make(0)
        if device.has(type(message)):
            reason = device.refusal(make)
            assert reason in {NackReason.NO_SESSION, NackReason.UNKNOWN_COMMAND}, (
                f"{type(message).__name__} before the handshake: {reason}"
            )


def test_a_repeated_command_is_answered_but_not_executed_again(device: Probe) -> None:
    """A repeated clear_stop must not clear a stop that came after its first copy."""
    device.handshake()
    device.stop()
    device.free()
    device.stop()
    command_id = device.next_id()
    clear = ClearStop(command_id, OPERATOR)
    assert device.reply_to(clear) == Ack(command_id, type_of(clear))
    assert device.status().stop_cause == StopCause.NONE
    device.stop()
    assert again(device, clear, command_id) == [Ack(command_id, type_of(clear))], (
        "the same answer was not repeated once"
    )
    assert device.status().stop_cause == OPERATOR, "the command was executed twice"


def test_a_command_repeated_late_is_not_executed_again(device: Probe) -> None:
    """The device stores sixteen replies, and sixteen other commands arrive in between."""
    device.handshake()
    device.stop()
    command_id = device.next_id()
    clear = ClearStop(command_id, OPERATOR)
    assert device.reply_to(clear) == Ack(command_id, type_of(clear))
    for _ in range(REMEMBERED):
        other = device.next_id()
        device.reply_to(SetMode(other, Mode.IDLE))
    device.stop()
    assert again(device, clear, command_id) == [], "a command that is too old was answered"
    assert device.status().stop_cause == OPERATOR, "the command was executed twice"


def test_a_repeated_rejection_stays_a_rejection(device: Probe) -> None:
    device.handshake()
    device.stop()
    command_id = device.next_id()
    wanted = SetMode(command_id, Mode.VELOCITY)
    rejected = Nack(command_id, type_of(wanted), NackReason.STOP_LATCHED)
    assert device.reply_to(wanted) == rejected
    device.free()
    assert again(device, wanted, command_id) == [rejected]
    assert device.status().mode == Mode.IDLE, "a rejected command was executed later"
    device.stop()


def test_the_last_sixteen_are_remembered(device: Probe) -> None:
    device.handshake()
    device.stop()
    command_id = device.next_id()
    clear = ClearStop(command_id, OPERATOR)
    device.reply_to(clear)
    for _ in range(REMEMBERED - 1):
        assert device.refusal(lambda i: SetMode(i, Mode.IDLE)) is None
    device.stop()
    assert again(device, clear, command_id) == [Ack(command_id, type_of(clear))]
    assert device.status().stop_cause == OPERATOR, "executed again after fifteen others"


def test_the_same_id_of_another_command_is_another(device: Probe) -> None:
    device.handshake()
    device.stop()
    command_id = device.next_id()
    assert isinstance(device.reply_to(SetMode(command_id, Mode.IDLE)), Ack)
    assert isinstance(device.reply_to(ClearStop(command_id, OPERATOR)), Ack)
    assert device.status().stop_cause == StopCause.NONE


def test_the_same_id_in_another_session_is_another(device: Probe) -> None:
    device.handshake()
    device.stop()
    command_id = device.next_id()
    assert isinstance(device.reply_to(ClearStop(command_id, OPERATOR)), Ack)
    device.stop()
    device.handshake()
    assert isinstance(device.reply_to(ClearStop(command_id, OPERATOR)), Ack)
    assert device.status().stop_cause == StopCause.NONE


def test_a_value_that_cannot_be_is_rejected(device: Probe) -> None:
    device.handshake()
    device.free()
    reason = device.refusal(lambda i: SetMode(i, 77))
    assert reason in {NackReason.BAD_VALUE, NackReason.UNSUPPORTED}, reason
    assert device.status().mode == Mode.IDLE
    if device.has(Reboot):
        boot = device.hello.boot_id if device.hello else 0
        assert device.refusal(lambda i: Reboot(i, 99)) is not None
        assert device.greet().boot_id == boot
