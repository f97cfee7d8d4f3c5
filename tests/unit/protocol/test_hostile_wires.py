"""The simulated wires with faults work as documented, so that other tests can rely on them."""

from __future__ import annotations

from random import Random

import pytest

from support.hostile import (
    BitFlips,
    Burst,
    Chunked,
    CutTail,
    Dead,
    Delayed,
    Duplicating,
    Garbage,
    Lossy,
    Pipe,
    Wire,
)

DATA = bytes(range(1, 101))


def through(wire: Wire, writes: int = 200) -> list[bytes]:
    out: list[bytes] = []
    for now_us in range(writes):
        wire.push(DATA, now_us)
        out += wire.pull(now_us)
    return out


def test_a_pipe_keeps_order_and_takes_its_time() -> None:
    pipe = Pipe(100)
    pipe.push(b"a", 0)
    pipe.push(b"", 1)
    pipe.push(b"b", 50)
    assert pipe.next_us() == 100
    assert pipe.pull(99) == []
    assert pipe.pull(149) == [b"a"]
    assert pipe.pull(150) == [b"b"]
    assert pipe.next_us() is None


def test_order_of_composition_decides_the_loss() -> None:
    single = b"".join(through(Lossy(Chunked(Pipe(), 1), p=0.2, rng=Random(1))))
    assert len(single) == pytest.approx(0.8 * 200 * 100, rel=0.02)
    whole = through(Chunked(Lossy(Pipe(), p=0.2, rng=Random(1)), 1))
    assert {len(piece) for piece in whole} == {1}
    assert len(whole) % 100 == 0
    assert 120 * 100 < len(whole) < 195 * 100


def test_the_same_seed_does_the_same_harm() -> None:
    def harm(seed: int) -> list[bytes]:
        rng = Random(seed)
        return through(Garbage(Burst(BitFlips(Pipe(), 0.3, rng), 0.3, rng), 0.3, rng))

    assert harm(4) == harm(4)
    assert harm(4) != harm(5)


def test_bit_flips_turn_one_bit() -> None:
    wire = BitFlips(Pipe(), p=0.25, rng=Random(2))
    wrong = 0
    for piece in through(wire):
        bits = sum((a ^ b).bit_count() for a, b in zip(piece, DATA, strict=True))
        assert bits <= 1
        wrong += bits
    assert wrong == wire.befell
    assert 30 < wrong < 70


def test_burst_spoils_one_stretch() -> None:
    spoilt = 0
    for piece in through(Burst(Pipe(), p=1.0, rng=Random(2), longest=8)):
        wrong = [i for i, byte in enumerate(piece) if byte != DATA[i]]
        assert len(piece) == len(DATA)
        assert not wrong or wrong[-1] - wrong[0] < 8
        spoilt += bool(wrong)
    assert spoilt > 100


def test_cut_tail_keeps_a_beginning() -> None:
    pieces = through(CutTail(Pipe(), p=1.0, rng=Random(2)))
    assert all(DATA.startswith(p) and 0 < len(p) < len(DATA) for p in pieces)
    assert len({len(p) for p in pieces}) > 50


def test_duplication_repeats_bytes_and_garbage_precedes_them() -> None:
    assert through(Duplicating(Pipe(), p=1.0, rng=Random(2)), 3) == [DATA] * 6
    noisy = through(Garbage(Pipe(), p=1.0, rng=Random(2), longest=9), 5)
    assert noisy[1::2] == [DATA] * 5
    assert all(0 < len(noise) <= 9 for noise in noisy[::2])


@pytest.mark.parametrize("reorder", [False, True])
def test_delayed_holds_back_and_may_reorder(*, reorder: bool) -> None:
    wire = Delayed(Pipe(), Random(2), low_us=10, high_us=500, reorder=reorder)
    out: list[tuple[int, int]] = []
    for now_us in range(2000):
        if now_us < 200:
            wire.push(bytes([now_us]), now_us)
        out += [(now_us, piece[0]) for piece in wire.pull(now_us)]
    assert sorted(sent for _, sent in out) == list(range(200))
    assert (out != sorted(out, key=lambda o: o[1])) is reorder
    assert all(10 <= arrived - sent <= 500 for arrived, sent in out)
    assert wire.next_us() is None


def test_delayed_gives_the_next_deadline() -> None:
    wire = Delayed(Pipe(3), Random(2), low_us=10, high_us=10)
    wire.push(b"a", 0)
    assert wire.next_us() == 3
    assert wire.pull(3) == []
    assert wire.next_us() == 13
    assert wire.pull(13) == [b"a"]


def test_a_dead_line_loses_its_bytes() -> None:
    wire = Dead(Pipe(), 10, 20)
    got: list[int] = []
    for now_us in range(30):
        wire.push(bytes([now_us]), now_us)
        got += [piece[0] for piece in wire.pull(now_us)]
    assert got == [*range(10), *range(20, 30)]
