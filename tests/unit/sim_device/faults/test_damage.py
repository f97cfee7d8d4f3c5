"""Damage by a bad line: effect and rate of each setting, however the bytes are split."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from protocol.can.frames import RECORD
from sim_device.faults.damage import Delay, LineDamage
from sim_device.faults.knobs import WireKnobs

DATA = bytes(i % 251 for i in range(100_000))
FRAMES = b"".join(RECORD.pack(i % 2000, 8, i.to_bytes(8, "little")) for i in range(2000))


def damage(knobs: WireKnobs, seed: int = 1) -> LineDamage:
    made = LineDamage(np.random.default_rng(seed))
    made.turn(knobs)
    return made


def ones(a: bytes, b: bytes) -> int:
    return sum((x ^ y).bit_count() for x, y in zip(a, b, strict=True))


def test_without_knobs_nothing_happens() -> None:
    line = damage(WireKnobs())
    assert line.stretch(DATA) == DATA
    assert line.frame(FRAMES[:16]) == [FRAMES[:16]]
    assert line.harmed == 0


def test_flips_turn_one_bit_in_the_share_of_bytes() -> None:
    line = damage(WireKnobs(flips=0.01))
    out = line.stretch(DATA)
    wrong = [i for i, (x, y) in enumerate(zip(DATA, out, strict=True)) if x != y]
    # 1000 expected; the tolerance is five times the binomial σ of 31.5.
    assert abs(len(wrong) - 1000) < 160
    assert ones(DATA, out) == len(wrong) == line.harmed


def test_loss_takes_the_share_of_bytes_and_keeps_the_order() -> None:
    line = damage(WireKnobs(loss=0.01))
    out = line.stretch(DATA)
    lost = len(DATA) - len(out)
    assert abs(lost - 1000) < 160
    assert lost == line.harmed
    rest = iter(DATA)
    assert all(byte in rest for byte in out), "the remaining bytes keep their order"


def test_duplicates_repeat_the_stretch_before() -> None:
    line = damage(WireKnobs(duplicates=0.001, duplicate_bytes=5))
    out = line.stretch(DATA)
    added = len(out) - len(DATA)
    assert abs(added / 5 - 100) < 50
    place = next(i for i in range(len(DATA)) if out[i] != DATA[i])
    assert out[place : place + 5] == DATA[place - 5 : place]
    assert out[place + 5 : place + 25] == DATA[place : place + 20]


def test_bursts_are_noise_for_their_length_and_nothing_else() -> None:
    line = damage(WireKnobs(bursts=0.0005, burst_bytes=16))
    out = line.stretch(DATA)
    assert len(out) == len(DATA)
    wrong = [i for i, (x, y) in enumerate(zip(DATA, out, strict=True)) if x != y]
    # About 50 bursts of 16 bytes are expected. One byte in 256 is correct by chance. Bursts that
    # overlap count as one burst.
    assert 400 < len(wrong) < 1200
    groups, last = 0, -100
    for i in wrong:
        groups += i - last > 16
        last = i
    assert 25 < groups < 80


def test_silence_lets_nothing_through_and_a_wrong_rate_nothing_right() -> None:
    assert damage(WireKnobs(silent=True)).stretch(DATA) == b""
    garbled = damage(WireKnobs(garbled=True)).stretch(DATA[:1000])
    assert garbled
    assert DATA[:4] not in garbled


@pytest.mark.parametrize(
    "knobs",
    [
        WireKnobs(flips=0.01),
        WireKnobs(loss=0.01),
        WireKnobs(duplicates=0.01, duplicate_bytes=7),
        WireKnobs(bursts=0.01, burst_bytes=9),
        WireKnobs(flips=0.02, loss=0.03, duplicates=0.01, duplicate_bytes=3, bursts=0.01),
    ],
)
def test_the_result_is_independent_of_the_split(knobs: WireKnobs) -> None:
    whole = damage(knobs).stretch(DATA[:5000])
    line, rng = damage(knobs), np.random.default_rng(7)
    cuts = sorted({0, 5000, *rng.integers(1, 5000, 400).tolist()})
    assert b"".join(line.stretch(DATA[a:b]) for a, b in itertools.pairwise(cuts)) == whole
    assert damage(knobs, seed=2).stretch(DATA[:5000]) != whole


def frames(line: LineDamage) -> tuple[list[bytes], int]:
    """Send 2000 frames; return the frames that arrive, and the number of destroyed frames."""
    out: list[bytes] = []
    destroyed = 0
    for i in range(0, len(FRAMES), 16):
        arrived = line.frame(FRAMES[i : i + 16])
        destroyed += arrived is None
        out += arrived or []
    return out, destroyed


def test_frames_are_destroyed_lost_or_duplicated_whole() -> None:
    whole = [FRAMES[i : i + 16] for i in range(0, len(FRAMES), 16)]
    out, destroyed = frames(damage(WireKnobs(flips=0.01)))
    # Expected: 1 - 0.99^16 = 14.9 % of 2000 = 297, with σ = 16.
    assert abs(destroyed - 297) < 80
    assert len(out) == 2000 - destroyed
    assert set(out) <= set(whole), "no frame arrives changed"
    out, destroyed = frames(damage(WireKnobs(loss=0.01)))
    assert destroyed == 0
    assert abs(2000 - len(out) - 297) < 80
    out, _ = frames(damage(WireKnobs(duplicates=0.01)))
    assert abs(len(out) - 2000 - 297) < 80
    assert all(out.count(record) <= 2 for record in out[:50])
    assert frames(damage(WireKnobs(garbled=True))) == ([], 2000)
    assert frames(damage(WireKnobs(silent=True))) == ([], 0)


def test_a_delay_keeps_order_and_bounds() -> None:
    line = Delay(np.random.default_rng(1))
    assert line.idle
    line.turn(WireKnobs(latency_us=5_000, jitter_us=20_000))
    waits: list[int] = []
    for i in range(500):
        sent_us = i * 50_000  # far apart, so that the delays are independent
        line.push(bytes([i % 256]), sent_us)
        at_us = line.next_us()
        assert at_us is not None
        assert line.pull(at_us - 1) == b""
        assert line.pull(at_us) == bytes([i % 256])
        waits.append(at_us - sent_us)
    assert min(waits) >= 5_000
    assert max(waits) <= 25_000
    assert 14_000 < sum(waits) / 500 < 16_000
    for i in range(100):  # close together, so that the delays overlap
        line.push(bytes([i]), i * 10)
    arrived = b""
    while (at := line.next_us()) is not None:
        arrived += line.pull(at)
    assert arrived == bytes(range(100))
    line.turn(WireKnobs())
    assert line.idle
