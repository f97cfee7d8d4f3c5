"""The kinds of events that a host puts on record in ``/events``: codes for machines.

The text of an event is for people and may change; no program compares it. Four sources name
their own kinds: ``planner`` and ``supervise`` (a planner's decisions, a rule's findings; plug-ins
add to them), ``estimator`` (:class:`~bridge.motion.estimation.disturbance.DisturbanceKind`) and
``fault`` (the emulator's faults).
"""

from __future__ import annotations

from enum import StrEnum


class EventKind(StrEnum):
    """What has happened. A kind keeps its name and its meaning in every version."""

    # ---- session: where it stands; the same names as bridge.session.states.State
    CLOSED = "closed"
    """The session was closed in order."""
    OPENING = "opening"
    """The session looks for the device."""
    AGREEING = "agreeing"
    """The device answered; both ends compare their messages."""
    READY = "ready"
    """Both ends agree; streams and commands start."""
    LOST = "lost"
    """The device fell silent; the session looks for it again."""
    FAILED = "failed"
    """Of source ``session``: it cannot go on. Of ``request``: what another thread asked for raised
    an error. Of ``recorder``: the log cannot be written any more."""

    # ---- session: why it cannot go on
    SILENCE = "silence"
    """Nothing was received."""
    GARBAGE = "garbage"
    """Bytes were received, and no intact frame."""
    ECHO = "echo"
    """Only the host's own messages came back."""
    WORDS = "words"
    """The other end sent a line of text."""
    VERSION = "version"
    """The device speaks another version of the protocol."""
    DEAF = "deaf"
    """The device sends, and does not hear the host."""
    RESTLESS = "restless"
    """The device names a new boot in every hello, or boots again and again."""
    DISAGREEMENT = "disagreement"
    """Both ends have too few messages in common."""
    OTHER_DEVICE = "other_device"
    """Another device than before answered."""
    OTHER_HOST = "other_host"
    """Another host sends on this bus; of source ``link`` as well."""
    OTHER_NODE = "other_node"
    """Another node than the one asked for answered."""
    SEVERAL = "several"
    """Several devices answered, and no node was asked for."""

    # ---- session: what else
    PHASE = "phase"
    """The run changed its phase; ``phase`` is the new one (:class:`bridge.run.mission.Phase`)."""
    LATE = "late"
    """The host was held up; one control step drove nothing."""
    SCHEMA = "schema"
    """The device declares a message otherwise than the host."""
    NEW_SCHEMA = "new_schema"
    """The device is back with other messages than before."""
    NEW_BOOT = "new_boot"
    """The device is back, and has booted since; ``reset_cause``."""
    SAME_BOOT = "same_boot"
    """The device is back in the same boot."""
    ASKING = "asking"
    """The run lost its device and waits for a person."""
    PARAMETER = "parameter"
    """A parameter of the device differs from the robot file."""
    CRASH = "crash"
    """The host's loop failed; the robot was stopped. ``traceback``."""
    NO_SUMMARY = "no_summary"
    """After a crash the run's summary could not be made."""

    # ---- link
    DAMAGED = "damaged"
    """Bytes that are no frame were received; ``frames``, ``bytes``, and a count of each damage."""
    REJECTED = "rejected"
    """Intact frames were of no use; ``frames``, ``type``, and a count of each reason."""
    STATISTICS = "statistics"
    """Rate, loss, order and age of each message, and the round trip, every ten seconds."""
    SLOW = "slow"
    """The round trip is too long to drive."""
    QUICK = "quick"
    """The round trip is short enough to drive again."""
    STUCK = "stuck"
    """The port took no bytes for too long; what waited was dropped."""
    PORT_LOST = "port_lost"
    """The port cannot be read or written any more."""
    PORT_BACK = "port_back"
    """The port is open again."""
    LATENCY = "latency"
    """The port's driver delays what it receives."""
    LAN = "lan"
    """Others on the network can read and write the bus."""
    NO_SOCKET = "no_socket"
    """Other shells cannot reach this run."""

    # ---- device and safety
    FAULT = "fault"
    """The device reports a new fault."""
    LATCH = "latch"
    """The device's stop cause changed."""
    STOP = "stop"
    """The host asked for a stop; ``cause``."""

    # ---- clock
    STEP = "step"
    """The device's clock jumped against the host's."""
    SET = "set"
    """The device's clock was set anew; the estimate begins again."""
    DECLARED = "declared"
    """A round trip was shorter than the delays that were declared."""

    # ---- recorder
    ROTATED = "rotated"
    """The log goes on in another file; ``next`` or ``previous``."""
    OVERFLOW = "overflow"
    """Records were dropped, because the disk is too slow."""

    # ---- people, room and robot
    MARK = "mark"
    """The operator marked this moment; ``number``, ``x_m``, ``y_m``."""
    GAMEPAD_GONE = "gamepad_gone"
    """The gamepad was unplugged."""
    NOT_PAUSED = "not_paused"
    """The device did not pause its planner as it was asked to."""
    NOT_RESUMED = "not_resumed"
    """The device did not resume its planner as it was asked to."""
    PRINTED = "printed"
    """A line that the person read during bring-up."""
    START = "start"
    """The robot does not seem to stand at the room's start."""
    CAUTION = "caution"
    """The robot file or the room has something that will not work well."""
