"""Kinds of the events that a host records in the topic ``/events``; they are codes for programs.

The text of an event is for people and may change, so programs must not compare it. Four sources
define their own kinds. ``planner`` records a planner's decisions, ``supervise`` a rule's findings;
plug-ins may add kinds to both. ``estimator`` has the kinds of
:class:`~bridge.motion.estimation.disturbance.DisturbanceKind`. ``fault`` has the emulator's faults.
"""

from __future__ import annotations

from enum import StrEnum


class EventKind(StrEnum):
    """Kind of an event. Its name and meaning are the same in every version."""

    # ---- session: its state; the same names as bridge.session.states.State
    CLOSED = "closed"
    """The session was closed cleanly."""
    OPENING = "opening"
    """The session searches for the device."""
    NEGOTIATING = "negotiating"
    """The device answered; host and device compare their messages."""
    READY = "ready"
    """Host and device are compatible; streams and commands start."""
    LOST = "lost"
    """The device is silent; the session searches for it again."""
    FAILED = "failed"
    """Source ``session``: the session cannot continue. Source ``request``: another thread's request
    raised an error. Source ``recorder``: the log cannot be written any more."""

    # ---- session: why it cannot continue
    SILENCE = "silence"
    """Nothing was received."""
    GARBAGE = "garbage"
    """Bytes were received, but no intact frame."""
    ECHO = "echo"
    """Only the host's own messages were received."""
    WORDS = "words"
    """The peer sent a line of text instead of frames."""
    VERSION = "version"
    """The device uses another protocol version."""
    TRANSMIT_ONLY = "transmit_only"
    """The device sends but does not receive."""
    RESTLESS = "restless"
    """The device reports a new boot in every hello, or boots repeatedly."""
    INCOMPATIBLE = "incompatible"
    """Host and device are incompatible."""
    OTHER_DEVICE = "other_device"
    """A different device answered after a loss."""
    OTHER_HOST = "other_host"
    """Another host sends on this bus. Source ``link`` emits it as well."""
    OTHER_NODE = "other_node"
    """A node other than the requested one answered."""
    SEVERAL = "several"
    """Several devices answered, and no node was requested."""

    # ---- session: other
    PHASE = "phase"
    """The run changed its phase; ``phase`` is the new phase (:class:`bridge.run.mission.Phase`)."""
    LATE = "late"
    """The host was late; one control step sent no setpoint."""
    SCHEMA = "schema"
    """The device declares a message differently from the host."""
    NEW_SCHEMA = "new_schema"
    """The device has returned with a different schema."""
    NEW_BOOT = "new_boot"
    """The device has returned after a reboot; ``reset_cause`` is the reason of the reboot."""
    SAME_BOOT = "same_boot"
    """The device has returned without a reboot."""
    ASKING = "asking"
    """The run lost its device and waits for the operator."""
    PARAMETER = "parameter"
    """A parameter of the device differs from the robot file."""
    CRASH = "crash"
    """The host's loop failed and stopped the robot; ``traceback`` is the exception's traceback."""
    NO_SUMMARY = "no_summary"
    """The run's summary could not be computed after a crash."""

    # ---- link
    DAMAGED = "damaged"
    """The link received bytes that are not a frame. The data are ``frames``, ``bytes`` and a count
    for each kind of damage."""
    REJECTED = "rejected"
    """The link rejected intact frames. The data are ``frames``, ``type`` and a count for each
    reason."""
    STATISTICS = "statistics"
    """Statistics of the link, every ten seconds: rate, loss, order and age of each message, and the
    round-trip time."""
    SLOW = "slow"
    """The round-trip time is too long for motion."""
    QUICK = "quick"
    """The round-trip time allows motion again."""
    STUCK = "stuck"
    """The port accepted no bytes for too long; the queued bytes were dropped."""
    PORT_LOST = "port_lost"
    """The port cannot be read or written."""
    PORT_BACK = "port_back"
    """The port is open again."""
    LATENCY = "latency"
    """The port's driver delays received bytes."""
    LAN = "lan"
    """Other machines on the network can read and write the bus."""
    NO_SOCKET = "no_socket"
    """Other processes cannot reach this run."""

    # ---- device and safety
    FAULT = "fault"
    """The device reports a new fault."""
    LATCH = "latch"
    """The device's latched stop cause changed."""
    STOP = "stop"
    """The host requested a stop; ``cause`` is the stop cause."""

    # ---- clock
    STEP = "step"
    """The device's clock jumped relative to the host's."""
    SET = "set"
    """The device's clock was reset, so the time synchronisation starts again."""
    DECLARED = "declared"
    """A round trip was shorter than the declared minimum delays."""

    # ---- recorder
    ROTATED = "rotated"
    """The log continues in another file; ``next`` or ``previous`` is its name."""
    OVERFLOW = "overflow"
    """Records were dropped because the disk is too slow."""

    # ---- operator, room and robot
    MARK = "mark"
    """The operator marked this moment; the data are ``number``, ``x_m`` and ``y_m``."""
    GAMEPAD_GONE = "gamepad_gone"
    """The gamepad was unplugged."""
    NOT_PAUSED = "not_paused"
    """The device did not pause its planner on request."""
    NOT_RESUMED = "not_resumed"
    """The device did not resume its planner on request."""
    COMMAND_FAILED = "command_failed"
    """A command of ``--on`` failed, took too long or was dropped; the run continues."""
    PRINTED = "printed"
    """A line that bring-up printed."""
    START = "start"
    """The measured pose does not match the room's start pose."""
    DISPLACED = "displaced"
    """The robot was moved by hand. The floor swept since its last certain pose no longer counts."""
    CAUTION = "caution"
    """The robot file or the room file has a value that is likely to cause problems."""
