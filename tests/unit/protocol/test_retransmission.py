"""Commands: the sender retries after the measured round trip, and the device executes once."""

from __future__ import annotations

from itertools import pairwise

import pytest

from protocol.messages.device import Ack, Nack
from protocol.messages.host import ClearStop, SetMode, Stop
from protocol.messages.values import NackReason
from protocol.retransmission import (
    FIRST_TIMEOUT_US,
    MAX_TIMEOUT_US,
    MAX_TRIES,
    MIN_TIMEOUT_US,
    REMEMBERED,
    CommandLog,
    CommandSender,
    Outcome,
    RoundTripEstimate,
)

STOP, CLEAR, MODE = 0x01, 0x05, 0x06


def mode(command_id: int) -> SetMode:
    return SetMode(command_id, 1)


def stop(command_id: int) -> Stop:
    return Stop(command_id, 4)


def run_until_silent(sender: CommandSender, now_us: int) -> tuple[list[tuple[int, bool]], Outcome]:
    """Return the time of each try, whether it was marked as a retry, and the outcome."""
    sent: list[tuple[int, bool]] = []
    for _ in range(100):
        messages, outcomes = sender.due(now_us)
        sent += [(now_us, retry) for _, retry in messages]
        if outcomes:
            return sent, outcomes[0]
        deadline = sender.next_deadline_us()
        assert deadline is not None
        assert sender.due(deadline - 1) == ([], [])  # not a microsecond too early
        now_us = deadline
    raise AssertionError(sent)


# ---- round trip (RFC 6298, section 2) -----------------------------------------------------


def test_before_a_measurement_the_timeout_is_the_first_one() -> None:
    assert RoundTripEstimate().timeout_us == FIRST_TIMEOUT_US


def test_the_first_measurement_sets_mean_and_half_of_it_as_variation() -> None:
    round_trip = RoundTripEstimate()
    round_trip.add(40_000)
    assert (round_trip.smoothed_us, round_trip.variation_us) == (40_000, 20_000)
    assert round_trip.timeout_us == 40_000 + 4 * 20_000


def test_later_measurements_are_smoothed_by_an_eighth_and_a_quarter() -> None:
    round_trip = RoundTripEstimate()
    round_trip.add(40_000)
    round_trip.add(48_000)
    # variation: 3/4 * 20000 + 1/4 * |40000 - 48000|, where 40000 is the mean before the update
    assert round_trip.variation_us == 17_000
    assert round_trip.smoothed_us == 41_000
    assert round_trip.timeout_us == 41_000 + 4 * 17_000


def test_the_timeout_has_a_floor_and_a_ceiling() -> None:
    fast, slow = RoundTripEstimate(), RoundTripEstimate()
    for _ in range(50):
        fast.add(300)
        slow.add(5_000_000)
    assert fast.timeout_us == MIN_TIMEOUT_US
    assert slow.timeout_us == MAX_TIMEOUT_US


def test_a_steady_line_keeps_a_margin_above_its_round_trip() -> None:
    steady = RoundTripEstimate()
    for _ in range(200):
        steady.add(50_000)
    assert steady.timeout_us == 51_000


# ---- sender -------------------------------------------------------------------------------


def test_a_command_is_due_at_once_and_an_answer_ends_it() -> None:
    sender = CommandSender(first_id=7)
    assert sender.next_deadline_us() is None
    assert sender.issue(mode, MODE, 1_000) == 7
    assert sender.next_deadline_us() == 1_000
    assert sender.due(1_000) == ([(SetMode(7, 1), False)], [])
    assert sender.reply(Ack(7, MODE), 3_000) == Outcome(SetMode(7, 1), accepted=True, reason=None)
    assert sender.idle
    assert sender.round_trip.smoothed_us == 2_000


def test_a_rejection_gives_its_reason() -> None:
    sender = CommandSender()
    sender.issue(mode, MODE, 0)
    sender.due(0)
    outcome = sender.reply(Nack(1, MODE, NackReason.STOP_LATCHED), 10)
    assert outcome == Outcome(SetMode(1, 1), accepted=False, reason=NackReason.STOP_LATCHED)
    assert not outcome.timed_out


def test_the_first_reason_is_not_reported_as_silence() -> None:
    outcome = Outcome(SetMode(1, 1), accepted=False, reason=NackReason.UNKNOWN_COMMAND)
    assert not outcome.timed_out  # although the value of this reason is 0


def test_without_an_answer_the_wait_doubles_and_then_it_ends() -> None:
    sender = CommandSender()
    sender.issue(mode, MODE, 0)
    sent, outcome = run_until_silent(sender, 0)
    moments = [t for t, _ in sent]
    waits = [b - a for a, b in pairwise(moments)]
    assert waits == [100_000, 200_000, 400_000, 800_000, 1_000_000]
    assert [retry for _, retry in sent] == [False] + [True] * (MAX_TRIES - 1)
    assert outcome == Outcome(SetMode(1, 1), accepted=False, reason=None)
    assert outcome.timed_out
    assert sender.idle


def test_the_measured_round_trip_sets_the_waits() -> None:
    sender = CommandSender()
    sender.round_trip.add(10_000)  # timeout 10 + 4 * 5 ms
    sender.issue(mode, MODE, 0)
    sent, _ = run_until_silent(sender, 0)
    assert [t for t, _ in sent] == [0, 30_000, 90_000, 210_000, 450_000, 930_000]


def test_karn_a_repeated_command_s_answer_is_not_timed() -> None:
    sender = CommandSender()
    sender.issue(mode, MODE, 0)
    sender.due(0)
    sender.due(FIRST_TIMEOUT_US)
    assert sender.reply(Ack(1, MODE), FIRST_TIMEOUT_US + 10) is not None
    assert sender.round_trip.smoothed_us is None


def test_the_round_trip_counts_from_the_writing_not_from_the_wish() -> None:
    sender = CommandSender()
    sender.issue(mode, MODE, 0)
    sender.due(15_000)
    sender.reply(Ack(1, MODE), 17_000)
    assert sender.round_trip.smoothed_us == 2_000


@pytest.mark.parametrize(
    "reply", [Ack(2, MODE), Ack(1, CLEAR), Nack(1, STOP, 1)], ids=["id", "type", "refusal"]
)
def test_a_reply_to_something_else_changes_nothing(reply: Ack | Nack) -> None:
    sender = CommandSender()
    sender.issue(mode, MODE, 0)
    sender.due(0)
    assert sender.reply(reply, 5) is None
    assert not sender.idle


def test_a_second_reply_is_ignored() -> None:
    sender = CommandSender()
    sender.issue(mode, MODE, 0)
    sender.due(0)
    assert sender.reply(Ack(1, MODE), 5) is not None
    assert sender.reply(Nack(1, MODE, 1), 6) is None


def test_an_earlier_sessions_reply_does_not_answer_an_unsent_command() -> None:
    sender = CommandSender()
    sender.issue(mode, MODE, 0)
    assert sender.reply(Ack(1, MODE), 0) is None
    assert sender.due(0) == ([(SetMode(1, 1), False)], [])


def test_stop_is_repeated_for_ever() -> None:
    sender = CommandSender()
    sender.issue(stop, STOP, 0, forever=True)
    now_us, tries = 0, 0
    while now_us < 3_600_000_000:
        messages, outcomes = sender.due(now_us)
        assert not outcomes
        tries += len(messages)
        deadline = sender.next_deadline_us()
        assert deadline is not None
        assert deadline - now_us <= MAX_TIMEOUT_US
        now_us = deadline
    assert tries >= 3_600
    outcome = sender.reply(Ack(1, STOP), now_us)
    assert outcome is not None
    assert outcome.accepted


def test_ids_wrap_and_pass_over_the_one_that_still_waits() -> None:
    sender = CommandSender(first_id=0xFFFF)
    assert sender.issue(stop, STOP, 0, forever=True) == 0xFFFF
    for expected in range(0xFFFF):
        command_id = sender.issue(mode, MODE, 0)
        assert command_id == expected
        sender.due(0)
        sender.reply(Ack(command_id, MODE), 0)
    assert sender.issue(mode, MODE, 0) == 0


def test_cancel_removes_everything() -> None:
    sender = CommandSender()
    sender.issue(mode, MODE, 0)
    sender.issue(stop, STOP, 0, forever=True)
    sender.cancel()
    assert sender.idle
    assert sender.due(10**9) == ([], [])


def test_several_commands_keep_their_own_time_and_order() -> None:
    sender = CommandSender()
    sender.issue(mode, MODE, 0)
    sender.issue(stop, STOP, 0)
    assert sender.due(0)[0] == [(SetMode(1, 1), False), (Stop(2, 4), False)]
    sender.issue(mode, MODE, 50_000)
    assert sender.next_deadline_us() == 50_000
    assert sender.due(50_000)[0] == [(SetMode(3, 1), False)]
    assert sender.due(100_000)[0] == [(SetMode(1, 1), True), (Stop(2, 4), True)]


# ---- log ----------------------------------------------------------------------------------


class Acts:
    """An action that counts how often it is executed."""

    def __init__(self, answer: int | None = None) -> None:
        self.count = 0
        self.answer = answer

    def __call__(self) -> int | None:
        self.count += 1
        return self.answer


def test_a_command_is_carried_out_and_a_repeat_only_answered() -> None:
    log, act = CommandLog(), Acts()
    for _ in range(5):
        assert log.once(9, MODE, SetMode(3, 1), act) == Ack(3, MODE)
    assert act.count == 1


def test_a_rejection_is_repeated_unchanged() -> None:
    log = CommandLog()
    reject, accept = Acts(NackReason.UNKNOWN_COMMAND), Acts()
    first = log.once(9, MODE, SetMode(3, 1), reject)
    assert first == Nack(3, MODE, 0)
    assert log.once(9, MODE, SetMode(3, 1), accept) == first
    assert (reject.count, accept.count) == (1, 0)


def test_another_session_or_type_is_no_repeat() -> None:
    log, act = CommandLog(), Acts()
    log.once(9, MODE, SetMode(3, 1), act)
    log.once(10, MODE, SetMode(3, 1), act)
    assert log.once(9, CLEAR, ClearStop(3, 1), act) == Ack(3, CLEAR)
    assert act.count == 3


def test_the_last_sixteen_are_kept_and_older_ones_are_not_executed_again() -> None:
    log, act = CommandLog(), Acts()
    assert REMEMBERED == 16
    for command_id in range(17):
        log.once(9, MODE, SetMode(command_id, 1), act)
    for command_id in range(1, 17):
        log.once(9, MODE, SetMode(command_id, 1), act)
    assert act.count == 17
    assert log.once(9, MODE, SetMode(0, 1), act) is None
    assert act.count == 17


@pytest.mark.parametrize("first_id", [0, 0xFFF8])
def test_a_late_command_is_executed_once_after_any_other_commands(first_id: int) -> None:
    """The device keeps the outcome of a late command, whatever ids come after it."""
    log, act = CommandLog(), Acts()
    newest, late = 17, [*range(1, 8)]

    def once(number: int) -> None:
        log.once(9, MODE, SetMode((first_id + number) & 0xFFFF, 1), act)

    for number in [8, *late, *range(9, newest + 1), *range(1, newest + 1)]:
        once(number)
    assert act.count == newest


def test_ids_of_another_session_and_of_none_are_not_compared() -> None:
    log, act = CommandLog(), Acts()
    for session_id, command_id in ((9, 1000), (10, 5), (10, 6), (0, 900), (0, 3), (0, 2)):
        assert log.once(session_id, MODE, SetMode(command_id, 1), act) is not None
    assert act.count == 6
