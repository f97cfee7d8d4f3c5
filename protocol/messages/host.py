"""Messages from the host to a device."""

from __future__ import annotations

from typing import Annotated

from protocol.messages.values import (
    Mode,
    OnboardPlanner,
    ParameterKind,
    PlannerAction,
    RebootKind,
    StopCause,
)
from protocol.schema.fields import (
    I16,
    U8,
    U16,
    U32,
    number,
    si,
    text,
)
from protocol.schema.message import Direction, Message, RateClass, message

_HOST = Direction.HOST
_STREAM, _COMMAND, _RARE = RateClass.STREAM, RateClass.COMMAND, RateClass.RARE

_ID = number(U16, "id", "counted up by the host; identifies the command in its reply")


@message(0x00, _HOST, _RARE, bootstrap=True, to_all=True, tagged=False)
class StopAll(Message):
    """Every device stops and latches ``operator``. All senders send the same bytes."""


@message(0x01, _HOST, _COMMAND, bootstrap=True, tagged=False)
class Stop(Message):
    """Stop sent by the session's owner; latched with its cause, repeated until acknowledged."""

    command_id: Annotated[int, _ID]
    cause: Annotated[int, number(U8, "enum", "cause to latch", enum=StopCause, low=1)]


@message(0x02, _HOST, _STREAM, default_hz=50, minimal=True)
class VelocitySetpoint(Message):
    """Body velocity, valid until its time to live expires."""

    v: Annotated[int, number(I16, "m/s", "forward speed", scale="0.0001")]
    yaw_rate: Annotated[int, number(I16, "rad/s", "counter-clockwise", scale="0.0002")]
    time_to_live: Annotated[
        int, number(U8, "s", "the device ramps to rest when it expires", scale="0.001", high=250)
    ]
    counter: Annotated[int, number(U8, "count", "must advance; wraps")]

    v_m_s = si("v")
    yaw_rate_rad_s = si("yaw_rate")
    time_to_live_s = si("time_to_live")


@message(0x0A, _HOST, _STREAM, default_hz=50)
class WheelDuty(Message):
    """Motor duties; accepted only in bring-up mode, which limits them."""

    left: Annotated[
        int, number(I16, "duty", "forward positive", scale="1/10000", low=-10000, high=10000)
    ]
    right: Annotated[
        int, number(I16, "duty", "forward positive", scale="1/10000", low=-10000, high=10000)
    ]
    time_to_live: Annotated[
        int, number(U8, "s", "the motors are off when it expires", scale="0.001", high=250)
    ]
    counter: Annotated[int, number(U8, "count", "must advance; wraps")]

    left_duty = si("left")
    right_duty = si("right")
    time_to_live_s = si("time_to_live")


@message(0x04, _HOST, _RARE, bootstrap=True, to_all=True, tagged=False)
class HostHello(Message):
    """Opens a session; sent again with ``negotiated`` = 1 after schema negotiation."""

    catalogue_hash: Annotated[int, number(U32, "hash", "of the host's whole catalogue")]
    session_id: Annotated[int, number(U32, "id", "random, new for each session", low=1)]
    boot_id: Annotated[int, number(U32, "id", "of the device's hello; 0: unknown")]
    negotiated: Annotated[int, number(U8, "bits", "1: negotiation complete", high=1)]
    name: Annotated[str, text("the host program and its version")]


@message(0x05, _HOST, _COMMAND, minimal=True)
class ClearStop(Message):
    """Release the latched stop if its cause equals ``cause``."""

    command_id: Annotated[int, _ID]
    cause: Annotated[int, number(U8, "enum", "the cause to clear", enum=StopCause, low=1)]


@message(0x06, _HOST, _COMMAND, minimal=True)
class SetMode(Message):
    """Select what moves the wheels; rejected while a stop is latched."""

    command_id: Annotated[int, _ID]
    mode: Annotated[int, number(U8, "enum", "requested mode", enum=Mode)]


@message(0x07, _HOST, _RARE, to_all=True, minimal=True, tagged=False)
class TimeRequest(Message):
    """Ask for the device's clock; also keeps the session alive."""

    ping: Annotated[int, number(U8, "id", "copied into the reply")]


@message(0x08, _HOST, _RARE, bootstrap=True, tagged=False)
class Describe(Message):
    """Ask for the device's declaration of one message."""

    described_type: Annotated[int, number(U8, "id", "requested message type", high=0x7E)]
    field_count: Annotated[int, number(U8, "count", "fields that the host declares")]


@message(0x09, _HOST, _COMMAND)
class PlannerCommand(Message):
    """Start, pause, resume or abort the device's own planner."""

    command_id: Annotated[int, _ID]
    action: Annotated[int, number(U8, "enum", "requested action", enum=PlannerAction)]
    planner: Annotated[int, number(U8, "enum", "planner to start", enum=OnboardPlanner)]


@message(0x70, _HOST, _COMMAND)
class GetParameter(Message):
    """Ask for one parameter; ``parameter_value`` precedes the acknowledgement."""

    command_id: Annotated[int, _ID]
    parameter: Annotated[int, number(U8, "id", "index of the parameter, from 0 without gaps")]


@message(0x71, _HOST, _COMMAND)
class SetParameter(Message):
    """Change one parameter until the next boot; ``save_parameters`` keeps it."""

    command_id: Annotated[int, _ID]
    parameter: Annotated[int, number(U8, "id", "index of the parameter")]
    kind: Annotated[int, number(U8, "enum", "must equal the parameter's kind", enum=ParameterKind)]
    value: Annotated[int, number(U32, "raw", "32 bits, interpreted by kind")]


@message(0x72, _HOST, _COMMAND)
class SaveParameters(Message):
    """Store the current values of all parameters in flash memory."""

    command_id: Annotated[int, _ID]


@message(0x0D, _HOST, _COMMAND)
class SetStreamRate(Message):
    """Change the rate of a stream until the session ends."""

    command_id: Annotated[int, _ID]
    stream_type: Annotated[int, number(U8, "id", "message type of the stream", high=0x7E)]
    rate: Annotated[int, number(U16, "Hz", "0: off", scale="0.1", high=10000)]

    rate_hz = si("rate")


@message(0x0E, _HOST, _COMMAND)
class Reboot(Message):
    """Reboot; acknowledged first, rejected while the robot moves."""

    command_id: Annotated[int, _ID]
    kind: Annotated[int, number(U8, "enum", "kind of reboot", enum=RebootKind)]


@message(0x73, _HOST, _COMMAND)
class SetKey(Message):
    """Set the key that authenticates motion; over a local UART only, never readable."""

    command_id: Annotated[int, _ID]
    key_0: Annotated[int, number(U32, "raw", "bytes 0 to 3 of the key; all words 0: no key")]
    key_1: Annotated[int, number(U32, "raw", "bytes 4 to 7")]
    key_2: Annotated[int, number(U32, "raw", "bytes 8 to 11")]
    key_3: Annotated[int, number(U32, "raw", "bytes 12 to 15")]

    def __repr__(self) -> str:
        """Omit the key: a message may appear in an exception or in a test's output."""
        return f"SetKey(command_id={self.command_id})"


@message(0x0C, _HOST, _RARE, bootstrap=True, tagged=False)
class DescribeEnum(Message):
    """Ask for the device's numbering of one enumeration."""

    enumeration: Annotated[
        int, number(U32, "hash", "hash of its name and kind; start of its chain")
    ]
    member_count: Annotated[int, number(U8, "count", "members that the host declares")]
