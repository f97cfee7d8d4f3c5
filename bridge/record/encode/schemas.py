"""Sweepctl's protobuf messages: one for each message of the catalogue, and the host's messages.

A field's number is computed from its position. New fields are only appended. So a number has the
same meaning in every version of a message.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from bridge.record.encode.layout import FieldKind, FlatField, FlatMessage
from bridge.record.encode.protobuf_wire import varint
from bridge.record.encode.rows import scaled, whole
from protocol.schema.catalogue import CATALOGUE, PROTOCOL_VERSION

if TYPE_CHECKING:
    from bridge.record.encode.rows import Source
    from bridge.session.records import (
        ClockRecord,
        DeviceMessage,
        EventRecord,
        PlannerRecord,
        PoseRecord,
        RawCan,
    )
    from protocol.schema.catalogue import Catalogue
    from protocol.schema.fields import Field
    from protocol.schema.message import MessageSpec

_T_US, _NODE, _BOUND = 1, 2, 3
_FIRST_FIELD = 4
"""First field number. Field i of the message has number 4 + 2i, and its value in SI units 5 +
2i."""


def _raw_kind(field: Field) -> FieldKind:
    if field.wire.is_text:
        return FieldKind.STRING
    if not field.wire.is_integer:
        return FieldKind.BYTES
    return FieldKind.SFIXED32 if field.wire.low < 0 else FieldKind.FIXED32


class DeviceEncoder:
    """Encoder of ``/device/<name>``: each raw value, and the value in SI units.

    A value is absent if the device does not have the field or sends its sentinel. ``bound_ns`` (the
    clock's error bound) is absent without a clock mapping.
    """

    def __init__(self, spec: MessageSpec, *, has_si: bool = True) -> None:
        """Create an encoder. Without ``has_si`` all values in SI units are absent."""
        self.has_si = has_si
        raw = [
            FlatField(f.name, _raw_kind(f), _FIRST_FIELD + 2 * i) for i, f in enumerate(spec.fields)
        ]
        scaled = [(i, f) for i, f in enumerate(spec.fields) if f.si_suffix is not None]
        self.layout = FlatMessage(
            spec.cls.__name__,
            [
                FlatField("t_us", FieldKind.FIXED32, _T_US),
                FlatField("node", FieldKind.FIXED32, _NODE),
                FlatField("bound_ns", FieldKind.FIXED64, _BOUND),
                *raw,
                *(
                    FlatField(f"{f.name}{f.si_suffix}", FieldKind.DOUBLE, _FIRST_FIELD + 2 * i + 1)
                    for i, f in scaled
                ),
            ],
        )
        # Values that are always present only need a gain and an offset. This halves the time.
        self._gains = [(i, f.si_gain, f.si_offset) for i, f in scaled]
        self._sentinels = {i: f.none for i, f in scaled if f.none is not None}

    def encode(self, record: DeviceMessage) -> bytes:
        """Serialise one message."""
        return self.layout.encode(self.values(record))

    def values(self, record: DeviceMessage) -> list[Any]:
        """Return a value per field of the layout. None: the field is absent."""
        _, _, bound_ns, node, _, t_us, _, message = record
        raw: tuple[Any, ...] = message  # type: ignore[assignment]  # messages are tuples
        if not self.has_si:
            si: list[float | None] = [None] * len(self._gains)
        elif self._sentinels or None in raw:
            si = [self._si_or_none(raw[i], i, gain, offset) for i, gain, offset in self._gains]
        else:
            si = [raw[i] * gain + offset for i, gain, offset in self._gains]
        return [t_us, node, bound_ns, *raw, *si]

    def sources(self, head: tuple[int, int, int], raw: int) -> list[Source]:
        """Return the source of each field's value in a row.

        Args:
            head: Columns of ``t_us``, ``node`` and ``bound_ns``.
            raw: Column of the message's first field.

        """
        return [
            *(whole(column) for column in head),
            *(whole(raw + i) for i in range(len(self.layout.fields) - 3 - len(self._gains))),
            *(scaled(raw + i, gain, offset) for i, gain, offset in self._gains),
        ]

    def _si_or_none(self, raw: int | None, index: int, gain: float, offset: float) -> float | None:
        if raw is None or raw == self._sentinels.get(index):
            return None
        return raw * gain + offset


def device_encoders(catalogue: Catalogue = CATALOGUE) -> dict[str, DeviceEncoder]:
    """Return an encoder for every message of a catalogue, by message name."""
    return {spec.name: DeviceEncoder(spec) for spec in catalogue}


def catalogue_json() -> str:
    """Return all declarations as JSON. A reader can decode the raw bytes with this text alone."""
    return json.dumps(
        {
            "protocol_version": PROTOCOL_VERSION,
            "hash": f"{CATALOGUE.hash:08x}",
            "messages": [_message_json(spec) for spec in CATALOGUE],
        },
        indent=1,
    )


def _message_json(spec: MessageSpec) -> dict[str, Any]:
    return {
        "type": spec.type_id,
        "name": spec.name,
        "direction": spec.direction.value,
        "rate": spec.rate.value,
        "default_hz": spec.default_hz,
        "bootstrap": spec.bootstrap,
        "doc": spec.doc,
        "fields": [_field_json(field) for field in spec.fields],
    }


def _field_json(field: Field) -> dict[str, Any]:
    return {
        "name": field.name,
        "wire": field.wire.name,
        "unit": field.unit,
        "scale": str(field.scale),
        "offset": str(field.offset),
        "low": field.low,
        "high": field.high,
        "none": field.none,
        "values": {e.name.lower(): int(e) for e in field.enum} if field.enum else None,
        "doc": field.doc,
    }


def _flat(name: str, **kinds: FieldKind) -> FlatMessage:
    return FlatMessage(name, [FlatField(f, k, i) for i, (f, k) in enumerate(kinds.items(), 1)])


RAW_BYTES = _flat("RawBytes", data=FieldKind.BYTES)
"""``/raw/uart/rx`` and ``tx``: the bytes of one read or write."""

RAW_CAN = _flat(
    "RawCan", outgoing=FieldKind.FIXED32, can_id=FieldKind.FIXED32, data=FieldKind.BYTES
)
"""``/raw/can``: one CAN frame. The top bits of the id are SocketCAN's flags."""

POSE_ESTIMATE = _flat(
    "PoseEstimate",
    x_m=FieldKind.DOUBLE,
    y_m=FieldKind.DOUBLE,
    theta_rad=FieldKind.DOUBLE,
    v_m_s=FieldKind.DOUBLE,
    yaw_rate_rad_s=FieldKind.DOUBLE,
    covariance_xx=FieldKind.DOUBLE,
    covariance_xy=FieldKind.DOUBLE,
    covariance_x_theta=FieldKind.DOUBLE,
    covariance_yy=FieldKind.DOUBLE,
    covariance_y_theta=FieldKind.DOUBLE,
    covariance_theta_theta=FieldKind.DOUBLE,
    gyro_bias_rad_s=FieldKind.DOUBLE,
    wheel_scale=FieldKind.DOUBLE,
)
"""``/pose/estimate``; covariances in m², m·rad and rad²."""

COMMAND = _flat(
    "Command",
    v_m_s=FieldKind.DOUBLE,
    yaw_rate_rad_s=FieldKind.DOUBLE,
    target_v_m_s=FieldKind.DOUBLE,
    target_yaw_rate_rad_s=FieldKind.DOUBLE,
)
"""``/cmd``: the setpoint that was sent, and the target before smoothing."""

PLANNER_STATE = _flat(
    "PlanState",
    turn_count=FieldKind.SFIXED32,
    lane_distance_m=FieldKind.DOUBLE,
    previous_lane_distance_m=FieldKind.DOUBLE,
    length_m=FieldKind.DOUBLE,
    case=FieldKind.SFIXED32,
    target_x_m=FieldKind.DOUBLE,
    target_y_m=FieldKind.DOUBLE,
    planner=FieldKind.STRING,
    state=FieldKind.STRING,
)
"""``/planner``: T, D, Prev-D and Length of the paper. ``target_*`` are absent without a target."""

EVENT = _flat(
    "Event",
    severity=FieldKind.STRING,
    source=FieldKind.STRING,
    kind=FieldKind.STRING,
    text=FieldKind.STRING,
    data_json=FieldKind.STRING,
)
"""``/events``: kind, text and data of an event."""

CLOCK_SYNC = _flat(
    "ClockSync",
    offset_ns=FieldKind.SFIXED64,
    drift_ppm=FieldKind.DOUBLE,
    bound_ns=FieldKind.SFIXED64,
    round_trip_ns=FieldKind.SFIXED64,
    samples=FieldKind.FIXED32,
    boot_id=FieldKind.FIXED32,
)
"""``/clock/sync``: Unix time minus device time, with its error bound."""


_RAW_KEY = RAW_BYTES.fields[0].tag
_RAW_HEADS = [_RAW_KEY + varint(size) for size in range(1024)]


def encode_raw(data: bytes) -> bytes:
    """Encode bytes as ``RawBytes``."""
    try:
        return _RAW_HEADS[len(data)] + data
    except IndexError:
        return _RAW_KEY + varint(len(data)) + data


def encode_raw_can(record: RawCan) -> bytes:
    """Encode a CAN frame as ``RawCan``."""
    return RAW_CAN.encode([int(record.outgoing), record.can_id, bytes(record.data)])


def estimate_values(record: PoseRecord) -> tuple[float, ...]:
    """Return the values of ``PoseEstimate``, with the upper triangle of the covariance."""
    _, pose, v_m_s, yaw_rate_rad_s, covariance, bias, scale = record
    xx, xy, xt, _, yy, yt, _, _, tt = covariance
    return (*pose, v_m_s, yaw_rate_rad_s, xx, xy, xt, yy, yt, tt, bias, scale)


def encode_planner(record: PlannerRecord) -> bytes:
    """Encode a planner state as ``PlanState``."""
    state = record.state
    target_x_m, target_y_m = state.target or (None, None)
    return PLANNER_STATE.encode(
        [
            state.turn_count,
            state.lane_distance_m,
            state.previous_lane_distance_m,
            state.length_m,
            state.case,
            target_x_m,
            target_y_m,
            record.planner,
            str(state.state),
        ]
    )


def encode_event(record: EventRecord) -> bytes:
    """Encode an event as ``Event``; values without a JSON form become text."""
    data = json.dumps(record.data, default=str, sort_keys=True)
    return EVENT.encode([record.severity.value, record.source, record.kind, record.text, data])


def encode_clock(record: ClockRecord) -> bytes:
    """Encode a clock fit as ``ClockSync``."""
    return CLOCK_SYNC.encode(list(record[1:]))
