"""The generated C codec, compared with the shared vectors and the Python codec; sanitizers on."""

from __future__ import annotations

import json
import os
import random
import statistics
import zlib
from typing import TYPE_CHECKING, Any

import pytest

from protocol.messages.host import Describe, DescribeEnum, StopAll
from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION, Catalogue
from protocol.schema.codec import Codec
from protocol.schema.comparison import describe
from protocol.schema.message import Direction
from protocol.uart.framing import DamagedFrame, Frame, UartParser, encode_frame
from protocol.uart.link import Link
from support.c_adapter import random_message, shown, words
from support.c_build import C_TESTS, COMPILERS, UNIT, compiler, generate, run
from support.root import ROOT

if TYPE_CHECKING:
    from pathlib import Path

    from support.c_build import Adapter, Generated

pytestmark = pytest.mark.slow

RANDOM_MESSAGES = 100_000
STREAMS = 600
FUZZ_RUNS = int(os.environ.get("SWEEPCTL_C_FUZZ_RUNS", "2000000"))
FUZZ_S = int(os.environ.get("SWEEPCTL_C_FUZZ_S", "30"))
"""Time limit of the nightly fuzzing, s; a campaign sets a longer time."""
SPECS = CATALOGUE.specs
NUMBERED = [spec for spec in SPECS if spec.cls is not StopAll]
"""Declarations of all messages except stop_all, because its frame is always the same bytes."""


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> Generated:
    return generate(tmp_path_factory.mktemp("c"))


@pytest.fixture(scope="module")
def adapter(generated: Generated) -> Adapter:
    return generated.adapter(flags=UNIT, sanitized=True)


@pytest.fixture(scope="module", params=COMPILERS)
def each_adapter(request: pytest.FixtureRequest, generated: Generated) -> Adapter:
    """Return the adapter by each compiler, with sanitizers.

    Clang builds it with the firmware's options, and the other compilers with the large CRC table.
    """
    name: str = request.param
    flags = UNIT if name == "clang" else ("-O2", "-DSP_CRC_FULL_TABLE")
    made = compiler(name)
    return generated.adapter(f"adapter_{name}", compiler=made, flags=flags, sanitized=True)


def vectors(name: str) -> list[dict[str, Any]]:
    path = ROOT / "tests" / "vectors" / f"{name}.json"
    found: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
    return found


def raw_words(vector: dict[str, Any]) -> dict[str, str]:
    """Return the raw values by name, in the adapter's text format."""
    spec = CATALOGUE.by_name[vector["message"]]
    kinds = {f.name: f.wire for f in spec.fields}
    return {
        name: str(raw)
        if kinds[name].is_integer
        else (raw.encode().hex() or "-" if kinds[name].is_text else raw)
        for name, raw in vector["raw"].items()
    }


def head(vector: dict[str, Any]) -> list[str]:
    h = vector["header"]
    return [str(h[k]) for k in ("version", "flags", "node", "type", "seq", "t_us")]


# ---- vectors ----------------------------------------------------------------------------------


def test_c_reads_every_intact_vector(each_adapter: Adapter) -> None:
    intact = vectors("messages") + vectors("edges")
    lines = each_adapter.ask("decode", [v["hex"] for v in intact])
    assert lines[1::2] == [". 1 0"] * len(intact)
    for vector, line in zip(intact, lines[::2], strict=True):
        event, _, *printed = line.split()
        assert (event, printed[:6]) == ("frame", head(vector)), vector["name"]
        assert printed[6] == (vector["payload"] or "-"), vector["name"]
        values = dict(word.split("=") for word in printed[7:])
        expected = raw_words(vector)
        if vector.get("decode_only"):  # the adapter shows an invalid text unchanged
            text = CATALOGUE.by_name[vector["message"]].text_field
            assert text is not None
            size = CATALOGUE.by_name[vector["message"]].layout.size
            expected[text.name] = vector["payload"][2 * size :]
        assert values == expected, vector["name"]


def test_c_writes_every_vector(each_adapter: Adapter) -> None:
    intact = [v for v in vectors("messages") + vectors("edges") if not v.get("decode_only")]
    intact = [v for v in intact if v["header"]["version"] == PROTOCOL_VERSION]
    questions = []
    for vector in intact:
        h, raw = vector["header"], raw_words(vector)
        values = [raw[f.name] for f in CATALOGUE.by_name[vector["message"]].fields]
        questions.append(
            " ".join(str(h[k]) for k in ("type", "node", "flags", "seq", "t_us"))
            + " "
            + " ".join(values)
        )
    assert each_adapter.ask("encode", questions) == [v["hex"] for v in intact]


def test_c_gives_the_vectors_si_values(adapter: Adapter) -> None:
    chosen = [v for v in vectors("messages") + vectors("edges") if v["si"]]
    answers = adapter.ask("si", [f"{v['header']['type']} {v['payload']}" for v in chosen])
    for vector, answer in zip(chosen, answers, strict=True):
        spec = CATALOGUE.by_name[vector["message"]]
        fields = {f"{f.name}{f.si_suffix}": f for f in spec.fields if f.si_suffix}
        values = dict(word.split("=") for word in answer.split())
        assert set(values) == set(vector["si"]), vector["name"]
        for name, wanted in vector["si"].items():
            value, back = values[name].split(":")
            raw = vector["raw"][fields[name].name]
            if wanted is None:  # C shows the number that means "no value"; the caller must compare
                assert raw == fields[name].none
                continue
            assert float(value) == pytest.approx(wanted, rel=1e-5, abs=1e-7), name
            assert int(back) == min(max(raw, fields[name].low), fields[name].high), name


def test_c_rejects_every_damaged_vector(each_adapter: Adapter) -> None:
    for vector in vectors("damaged"):
        (line, *_) = each_adapter.ask("decode", [vector["hex"]])
        if "damage" in vector:
            end = vector["offset"] + vector["length"] + 1  # end of the frame with its delimiter
            assert line == f"{vector['damage']} {end}", vector["name"]
            continue
        event, _, *printed = line.split()
        assert (event, printed[:6]) == ("frame", head(vector)), vector["name"]
        if vector["rejected"] == "direction":
            sent_by_device = vector["sent_by"] == "device"
            spec = CATALOGUE.by_type[vector["header"]["type"]]
            assert (spec.direction is Direction.DEVICE) is not sent_by_device
        else:
            assert printed[-1] == vector["rejected"], vector["name"]


@pytest.mark.parametrize("block", [1, 2, 7, 1000])
def test_c_gives_the_events_of_the_stream_vectors(each_adapter: Adapter, block: int) -> None:
    for vector in vectors("streams"):
        length = len(vector["hex"]) // 2
        cuts = ",".join(str(i) for i in range(block, length + block, block))
        lines = each_adapter.ask("decode", [f"{cuts} {vector['hex']}"])
        found = []
        for line in lines[:-1]:
            event, _, *printed = line.split()
            found.append(("frame", int(printed[3]), int(printed[4])) if event == "frame" else event)
        wanted = [
            ("frame", e["frame"]["type"], e["frame"]["seq"]) if "frame" in e else e["damage"]
            for e in vector["events"]
        ]
        assert found == wanted, vector["name"]


# ---- random messages --------------------------------------------------------------------------


def test_c_reads_what_python_writes(adapter: Adapter) -> None:
    rng, codec = random.Random(1), Codec()
    batches: list[str] = []
    wanted: list[str] = []
    for _ in range(RANDOM_MESSAGES // 500):
        batch = bytearray()
        for _ in range(500):
            spec = rng.choice(SPECS)
            message = random_message(rng, spec)
            type_id, payload = codec.encode(message)
            node, seq, flags = rng.randrange(16), rng.randrange(256), rng.randrange(16)
            t_us = rng.getrandbits(32)
            batch += encode_frame(node, type_id, seq, t_us, payload, flags)
            wanted.append(
                f"frame {len(batch)} {PROTOCOL_VERSION} {flags} {node} {type_id} {seq} {t_us} "
                f"{payload.hex() or '-'}{shown(spec, message)}"
            )
        batches.append(batch.hex())
        wanted.append(". 500 0")
    assert adapter.ask("decode", batches) == wanted


def test_python_reads_what_c_writes(adapter: Adapter) -> None:
    rng, codec, parser = random.Random(2), Codec(), UartParser()
    wanted = []
    questions = []
    for _ in range(RANDOM_MESSAGES):
        spec = rng.choice(NUMBERED)
        message = random_message(rng, spec)
        header = (rng.randrange(16), rng.randrange(16), rng.randrange(256), rng.getrandbits(32))
        wanted.append((spec, header, message))
        questions.append(" ".join(map(str, (spec.type_id, *header, *words(message)))))
    stream = bytes.fromhex("".join(adapter.ask("encode", questions)))
    found = parser.feed(stream)
    assert parser.damaged == 0
    assert len(found) == RANDOM_MESSAGES
    for frame, (spec, header, message) in zip(found, wanted, strict=True):
        assert isinstance(frame, Frame)
        assert (frame.node, frame.flags, frame.seq, frame.t_us) == header
        assert codec.decode(spec, frame.payload) == message


def test_c_writes_the_same_bytes_as_python(adapter: Adapter) -> None:
    rng, codec = random.Random(3), Codec()
    questions, wanted = [], []
    for spec in NUMBERED * 20:
        message = random_message(rng, spec)
        _, payload = codec.encode(message)
        questions.append(f"{spec.type_id} 3 0 9 77 {' '.join(words(message))}")
        wanted.append("00" + encode_frame(3, spec.type_id, 9, 77, payload).hex())
    assert adapter.ask("encode", questions) == wanted


def test_the_stop_of_every_device_is_the_same_bytes_from_c_and_python(adapter: Adapter) -> None:
    link = Link(Direction.HOST)
    link.send(StopAll(), 77, node=0)
    type_id = CATALOGUE.by_class[StopAll].type_id
    questions = [f"{type_id} {header}" for header in ("0 0 0 0", "3 1 9 77")]
    assert adapter.ask("encode", questions) == [link.data_to_send().hex()] * 2


def test_c_allows_the_payload_lengths_that_python_allows(adapter: Adapter) -> None:
    codec = Codec()
    rng = random.Random(4)
    for spec in SPECS:
        sizes = sorted({*range(spec.layout.size + 3), 40, 240, 241})
        payloads = [rng.randbytes(size) for size in sizes]
        answers = adapter.ask("payload", [f"{spec.type_id} {p.hex() or '-'}" for p in payloads])
        for payload, answer in zip(payloads, answers, strict=True):
            try:
                codec.decode(spec, payload)
            except Exception:  # noqa: BLE001 - any error in Python
                assert answer == "no", (spec.name, len(payload))
            else:
                kept = payload if spec.text_field else payload[: spec.layout.size]
                assert answer == f"ok {kept.hex() or '-'}", (spec.name, len(payload))


def test_c_does_not_write_beyond_a_frame(adapter: Adapter) -> None:
    spec = CATALOGUE.by_name["log_text"]
    size, log_text = spec.layout.size, spec.type_id
    fits, beyond = "61" * (241 - size), "61" * (242 - size)
    answers = adapter.ask("encode", [f"{log_text} 1 0 0 0 1 {text}" for text in (fits, beyond)])
    assert [len(a) // 2 for a in answers] == [256, 0]


# ---- damaged streams --------------------------------------------------------------------------


def damaged_stream(rng: random.Random) -> bytes:
    """Return frames, some damaged, with and without leading zeros, noise and overlong stretches."""
    out = bytearray()
    codec = Codec()
    for _ in range(rng.randrange(1, 12)):
        match rng.randrange(12):
            case 0:
                out += rng.randbytes(rng.randrange(30))
            case 1:
                stretch = rng.choice((250, 252, 253, 254, 255, 256, 300, 700))
                out += bytes(rng.randrange(1, 256) for _ in range(stretch))
            case 2:
                out += bytes(rng.randrange(1, 5))
            case _:
                type_id, payload = codec.encode(random_message(rng, rng.choice(SPECS)))
                frame = bytearray(encode_frame(1, type_id, rng.randrange(256), 5, payload))
                match rng.randrange(6):
                    case 0:
                        frame[rng.randrange(len(frame))] ^= 1 << rng.randrange(8)
                    case 1:
                        del frame[rng.randrange(len(frame)) :]
                    case 2:
                        at = rng.randrange(len(frame))
                        frame[at:at] = rng.randbytes(rng.randrange(1, 300))
                    case _:
                        pass
                out += bytes(rng.randrange(2)) + frame
    return bytes(out) + b"\0"  # the adapter's parser restarts for each line


def test_c_and_python_parsers_agree(each_adapter: Adapter) -> None:
    rng = random.Random(5)
    streams = [damaged_stream(rng) for _ in range(STREAMS)]
    questions = []
    for stream in streams:
        cuts = sorted(rng.randrange(1, len(stream) + 1) for _ in range(rng.randrange(9)))
        questions.append(",".join(map(str, [*cuts, len(stream)])) + " " + stream.hex())
    lines = iter(each_adapter.ask("decode", questions))
    damages = 0
    for stream in streams:
        parser = UartParser()
        for item in parser.feed(stream):
            printed = next(lines).split()
            if isinstance(item, DamagedFrame):
                assert printed == [item.damage.value, str(item.offset + item.length + 1)]
            else:
                numbers = (item.version, item.flags, item.node, item.type_id, item.seq, item.t_us)
                assert printed[0] == "frame"
                assert printed[2:8] == [str(n) for n in numbers]
                assert printed[8] == (item.payload.hex() or "-")
        damages += parser.damaged
        assert next(lines) == f". {parser.frames} {parser.damaged}"
    assert next(lines, None) is None
    assert damages > STREAMS  # the streams were damaged enough


# ---- CRC --------------------------------------------------------------------------------------


def test_crc_by_software_and_by_the_unit_is_zlibs(adapter: Adapter) -> None:
    rng = random.Random(6)
    data = [b"123456789", *(rng.randbytes(n) for n in range(254))]
    answers = adapter.ask("crc", [d.hex() or "-" for d in data])
    for piece, answer in zip(data, answers, strict=True):
        assert answer.split() == [str(zlib.crc32(piece))] * 3, len(piece)


# ---- comparison -------------------------------------------------------------------------------


def test_c_describes_every_message(adapter: Adapter) -> None:
    asked = [(t, n) for t in range(0x80) for n in (0, 1, 2, 5, 11, 255)]
    answers = adapter.ask("describe", [f"{t} {n}" for t, n in asked])
    assert answers[0] == str(CATALOGUE.hash)
    for (type_id, count), answer in zip(asked, answers[1:], strict=True):
        spec = CATALOGUE.by_type.get(type_id)
        direction = 0 if spec is None else 1 + (spec.direction is Direction.DEVICE)
        reply = describe(CATALOGUE, Describe(type_id, count))
        assert answer == " ".join(map(str, (*reply, direction)))


def test_c_describes_every_enumeration(adapter: Adapter) -> None:
    asked = [(key, n) for key in (*CATALOGUE.enums, 0, 1) for n in (0, 1, 3, 255)]
    answers = adapter.ask("describe-enum", [f"{key} {n}" for key, n in asked])
    for (key, count), answer in zip(asked, answers, strict=True):
        reply = describe(CATALOGUE, DescribeEnum(key, count))
        assert answer == " ".join(map(str, reply))


def test_a_minimal_build_reports_missing_messages(tmp_path: Path) -> None:
    kept = Catalogue(s.cls for s in SPECS if s.minimal)
    assert kept.hash != CATALOGUE.hash
    adapter = generate(tmp_path, built=kept).adapter(flags=("-DSP_MINIMAL",))
    first, *answers = adapter.ask("describe", [f"{t} 3" for t in range(0x80)])
    assert first == str(kept.hash)
    for type_id, answer in enumerate(answers):
        assert answer.split()[:4] == [str(v) for v in describe(kept, Describe(type_id, 3))]


# ---- fuzzing ------------------------------------------------------------------------------------


@pytest.mark.needs("clang")
@pytest.mark.parametrize(
    ("runs", "seconds"),
    [(50_000, 20), pytest.param(FUZZ_RUNS, FUZZ_S, marks=pytest.mark.nightly)],
    ids=["short", "long"],
)
def test_the_fuzzer_finds_nothing(generated: Generated, runs: int, seconds: int) -> None:
    sources = [
        generated.source,
        generated.directory / "adapter_table.c",
        C_TESTS / "adapter.c",
        C_TESTS / "fuzz_wire.c",
    ]
    flags = ("-O1", "-g", "-fsanitize=fuzzer,address,undefined", "-Dmain=adapter_main")
    fuzzer = generated.compile("fuzz_wire", sources, compiler=compiler("clang"), flags=flags)
    corpus = generated.directory / "corpus"
    corpus.mkdir(exist_ok=True)
    for kind in (b"\0", b"\1"):
        for index, vector in enumerate(vectors("messages") + vectors("streams")):
            data = bytes.fromhex(vector["hex"] if kind == b"\0" else vector.get("payload", "00"))
            (corpus / f"{kind[0]}-{index}").write_bytes(kind + data)
    bounds = (f"-runs={runs}", f"-max_total_time={seconds}", "-max_len=600", "-seed=1")
    run([fuzzer, *bounds, corpus], timeout_s=seconds + 90)


# ---- speed ------------------------------------------------------------------------------------


PER_CHECK = {"encode": 0.7, "decode": 0.4}
"""Minimum number of frames encoded and decoded in the time of one bitwise CRC: half of the smallest
measurement (encode 1.4 to 2.3, decode 0.83 to 1.4, with zig, clang and gcc)."""


def test_a_frame_costs_about_as_much_as_its_check_bit_by_bit(generated: Generated) -> None:
    """CPU times of one process are compared, so the machine's speed and other work cancel out."""
    program = generated.adapter("adapter_fast", flags=("-O2",)).program
    rounds = []
    for _ in range(5):
        lines = run([program, "bench", "200000"]).decode().splitlines()
        rates = {name: float(rate) for name, rate in (line.split() for line in lines)}
        rounds.append({name: rates[name] / rates["bits"] for name in PER_CHECK})
    medians = {name: statistics.median(r[name] for r in rounds) for name in PER_CHECK}
    assert all(medians[name] > lowest for name, lowest in PER_CHECK.items()), rounds
