"""The generated CAN database (DBC), read with cantools."""

from __future__ import annotations

import logging
import warnings
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Annotated

import cantools
import pytest

from protocol.authentication import Authenticator
from protocol.can.frames import from_record
from protocol.can.link import CanLink
from protocol.errors import FieldRangeError
from protocol.generate import render
from protocol.imu import NOMINAL
from protocol.messages.host import VelocitySetpoint
from protocol.schema.catalogue import CATALOGUE, Catalogue
from protocol.schema.fields import U8, U16, number
from protocol.schema.message import Direction, Message, RateClass, message

if TYPE_CHECKING:
    from pathlib import Path

    from cantools.database.can import Database
    from cantools.database.can import Message as Described


def database(catalogue: Catalogue = CATALOGUE, node: int = 1) -> Database:
    (text,) = render("dbc", catalogue, node).values()
    loaded = cantools.database.load_string(text, "dbc", strict=True)
    assert isinstance(loaded, cantools.database.can.Database)
    return loaded


@pytest.fixture(scope="module")
def db() -> Database:
    return database()


def described(db: Database, can_id: int) -> Described:
    return db.get_message_by_frame_id(can_id)


def test_it_loads_without_a_warning(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    ((name, text),) = render("dbc").items()
    assert name == "sweepctl-node1.dbc"
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    with caplog.at_level(logging.DEBUG), warnings.catch_warnings():
        warnings.simplefilter("error")
        for encoding in ("cp1252", "utf-8"):  # cp1252 is the default of cantools
            cantools.database.load_file(path, encoding=encoding, strict=True)
        cantools.database.load_file(path)
    assert caplog.records == []
    assert text.isascii()


def test_identifiers_lengths_senders_and_cycles_are_those_of_the_bus(db: Database) -> None:
    reported = {
        m.frame_id: (m.name, m.length, m.senders, m.cycle_time, m.is_extended_frame)
        for m in db.messages
    }
    assert reported == {
        0x0F1: ("auth_tag", 8, ["host"], None, False),
        0x021: ("velocity_setpoint", 8, ["host"], 20, False),
        0x0A1: ("wheel_duty", 8, ["host"], 20, False),
        0x101: ("sync", 8, ["device"], 100, False),
        0x111: ("status", 8, ["device"], 100, False),
        0x131: ("imu_acceleration", 8, ["device"], 10, False),
        0x141: ("imu_rotation", 8, ["device"], 10, False),
        0x151: ("imu_temperature", 4, ["device"], 1000, False),
        0x161: ("encoders", 6, ["device"], 20, False),
        0x201: ("range", 8, ["device"], 50, False),
        0x241: ("power", 7, ["device"], 200, False),
        0x281: ("link_counters_received", 8, ["device"], 1000, False),
        0x291: ("link_counters_dropped", 6, ["device"], 1000, False),
        0x2A1: ("link_counters_can", 6, ["device"], 1000, False),
        0x2C1: ("planner_state_target", 8, ["device"], 200, False),
        0x2D1: ("planner_state_lane", 8, ["device"], 200, False),
    }
    assert [n.name for n in db.nodes] == ["host", "device"]
    assert [m.name for m in db.messages if m.send_type != "Cyclic"] == ["auth_tag"]


def test_every_periodic_field_is_a_signal_with_its_text_and_receiver(db: Database) -> None:
    signals = {(m.frame_id, s.name): s for m in db.messages for s in m.signals}
    for spec in CATALOGUE:
        frames = [m for m in db.messages if m.name.startswith(spec.name)]
        if spec.rate is not RateClass.STREAM:
            assert frames == []
            continue
        receiver = "host" if spec.direction is Direction.DEVICE else "device"
        for field in spec.fields:
            (signal,) = (s for m in frames for s in m.signals if s.name == field.name)
            assert signal.comment
            assert signal.receivers == [receiver]
            assert signal.byte_order == "little_endian"
    assert all(s.comment for s in signals.values())


@pytest.mark.parametrize(
    ("can_id", "name", "wanted"),
    [
        (0x021, "v", ("m/s", 0.0001, 0, -3.2768, 3.2767)),
        (0x021, "time_to_live", ("s", 0.001, 0, 0, 0.25)),
        (0x0A1, "left", ("duty", 0.0001, 0, -1, 1)),
        (0x111, "load", ("%", 1, 0, 0, 100)),
        (0x131, "accel_z", ("m/s2", 9.80665 / 16384, 0, -19.6133, 9.80665 * 32767 / 16384)),
        (0x141, "gyro_z", ("deg/s", 1 / 131, 0, -32768 / 131, 32767 / 131)),
        (0x151, "temperature", ("degC", 1 / 340, 36.53, 36.53 - 32768 / 340, 36.53 + 32767 / 340)),
        (0x161, "left", (None, 1, 0, 0, 65535)),
        (0x201, "ultrasonic", ("m", 0.001, 0, 0, 4)),
        (0x201, "infrared_left", ("m", 0.00125, 0, 0, 0.3175)),
        (0x241, "battery", ("V", 0.001, 0, 0, 65.535)),
        (0x241, "motor_left", ("A", 0.02, 0, 0, 5.1)),
        (0x2D1, "length", ("m", 0.02, 0, 0, 5.1)),
        (0x201, "t16", ("s", 16e-6, 0, 0, 65535 * 16e-6)),
        (0x101, "t_us", ("us", 1, 0, 0, 0xFFFFFFFF)),
    ],
)
def test_units_scales_and_ranges(
    can_id: int, name: str, wanted: tuple[object, ...], db: Database
) -> None:
    s = described(db, can_id).get_signal_by_name(name)
    assert s.unit == wanted[0]
    numbers = (s.scale, s.offset, s.minimum, s.maximum)
    assert numbers == pytest.approx(wanted[1:], rel=1e-12)


def test_the_stamp_stands_before_the_payload(db: Database) -> None:
    stamps = {
        m.frame_id: (s.start, s.length, s.is_signed)
        for m in db.messages
        for s in m.signals
        if s.name in {"t16", "t_us"}
    }
    assert stamps.pop(0x101) == (0, 32, False)
    assert stamps == {
        m.frame_id: (0, 16, False) for m in db.messages if m.frame_id not in {0x0F1, 0x101}
    }


def test_a_signed_setpoint_s_tag_is_read(db: Database) -> None:
    link = CanLink(Direction.HOST)
    link.key = Authenticator(bytes(range(16)))
    link.key.begin(1, 2, 0x0001_FFFE)
    wanted = []
    for counter in (0xFFFF, 0x0000):  # the low 16 bits of the counter
        link.send(VelocitySetpoint(2000, 0, 200, 1), 0, node=1)
        data = link.data_to_send()
        setpoint, tag = (from_record(data[at : at + 16]) for at in (0, 16))
        assert setpoint is not None
        assert tag is not None
        assert (setpoint.can_id, tag.can_id) == (0x021, 0x0F1)
        reported = described(db, tag.can_id).decode(tag.data)
        wanted.append(int.from_bytes(tag.data[2:], "little"))
        assert reported == {"counter": counter, "tag": wanted[-1]}
    assert wanted[0] != wanted[1]


def test_values_have_their_names_and_nothing_there_has_one(db: Database) -> None:
    def names(can_id: int, name: str) -> dict[int, str]:
        choices = described(db, can_id).get_signal_by_name(name).choices
        return {k: str(v) for k, v in choices.items()} if choices else {}

    assert names(0x111, "mode") == {0: "idle", 1: "velocity", 2: "bringup", 3: "onboard"}
    assert names(0x111, "stop_cause")[4] == "operator"
    assert names(0x2C1, "phase")[8] == "finished"
    assert names(0x201, "ultrasonic") == {65535: "none"}
    assert names(0x201, "infrared_right") == {255: "none"}
    assert names(0x111, "faults") == {}  # a bit field: the comment names its bits
    assert "5 motor_stall" in str(described(db, 0x111).get_signal_by_name("faults").comment)


def test_a_device_s_database_has_its_number() -> None:
    ((name, _),) = render("dbc", node=7).items()
    assert name == "sweepctl-node7.dbc"
    assert {m.frame_id & 0x0F for m in database(node=7).messages} == {7}


@pytest.mark.parametrize("node", [0, 16, -1])
def test_there_is_no_database_of_a_device_that_cannot_be(node: int) -> None:
    with pytest.raises(FieldRangeError):
        render("dbc", node=node)


def test_another_catalogue_s_texts_cannot_break_it() -> None:
    @message(0x60, Direction.DEVICE, RateClass.STREAM, default_hz=3)
    class Odd(Message):
        """Says "quoted", twice; ± 漢.

        And goes on.
        """

        level: Annotated[int, number(U8, "count", 'a "level"; \\ and ;')]
        depth: Annotated[int, number(U16, "raw", "nothing: 7", high=6, none=7)]

    _, odd = database(Catalogue([Odd])).messages
    assert (odd.name, odd.length, odd.cycle_time) == ("odd", 5, 333)
    assert odd.comment == "Says 'quoted', twice; +- ?. And goes on."
    assert odd.get_signal_by_name("level").comment == "a 'level'; \\ and ;"
    assert odd.decode(b"\2\0\1\7\0") == {"level": 1, "depth": "none", "t16": 32e-6}


def test_the_imu_s_scale_can_be_that_of_the_device() -> None:
    scale = replace(NOMINAL, per_g=Fraction(8192), per_deg_s=Fraction("65.5"))
    text = next(iter(render("dbc", imu=scale).values()))
    described = cantools.database.load_string(text, "dbc")
    assert isinstance(described, cantools.database.can.Database)
    rotation = described.get_message_by_name("imu_rotation")
    assert float(rotation.get_signal_by_name("gyro_z").scale) == pytest.approx(1 / 65.5)
    acceleration = described.get_message_by_name("imu_acceleration")
    assert float(acceleration.get_signal_by_name("accel_z").scale) == pytest.approx(9.80665 / 8192)
    assert len(text.splitlines()) == len(next(iter(render("dbc").values())).splitlines())
