"""What PROTOCOL.md says in words; numbers that code keeps are filled in."""

from __future__ import annotations

HEAD = """\
# The wire

Made by `sweepctl generate md`; change the catalogue (`protocol/messages.py`) instead.

Protocol version {version}, catalogue `{hash:08x}`, {count} messages.

A host and a device talk over UART or over classic CAN, with the same messages and the same
meaning.

{contents}
"""

FRAMING = """\
## Framing

UART, 921 600 baud 8N1 unless told otherwise:

    00 | COBS( header 8 B | payload | CRC-32 4 B ) | 00

| offset | field | wire | meaning |
|---|---|---|---|
| 0 | `version`, `flags` | 4 + 4 bit | version in the high nibble; flag bit 0 authenticated, bit 1 \
retry, others 0 |
| 1 | `node` | u8 | the *device's* id, 1–15, in both directions; 0: all devices, for {to_all} \
alone |
| 2 | `type` | u8 | message type, 0–0x7e; it fixes the direction |
| 3 | `seq` | u8 | counts the sender's frames, wraps |
| 4 | `t_us` | u32 | sender's microsecond clock when the content was *sampled*, wraps |
| 8 | payload | 0–241 B | as below |
| 8 + n | CRC-32 | u32 | zlib's (reflected 0x04c11db7, starts and ends inverted) over header and \
payload |

- The closing zero ends every frame. The leading one is sent where the line was idle: with it, \
a damaged tail costs no intact neighbour. Lone or repeated zeros are no error.
- COBS is that of Cheshire and Baker (1999). A decoded frame has 12 to 253 B, so COBS adds exactly \
one byte.
- No frame is looked into before its CRC holds. A stream's payload has at most 25 B: up to a \
codeword of 37 B the CRC finds every 5-bit error.
- A payload that is longer or shorter than its message is refused, unless agreement says why.
- A device passes over a message for another node, and any message for node 0 but {to_all}: it \
answers none of them, and none of them keeps its session alive.
"""

CAN = """\
## Classic CAN

11-bit identifiers, at most 8 B, 500 kbit/s unless told otherwise, one host on a bus.
`identifier = type << 4 | node`: the type first, so that stop wins arbitration over everything.

**Periodic messages** are self-contained frames of up to 6 B of payload and `t16`, bits 4 to 19 of
`t_us` (16 µs a step, wraps after 1.05 s). `sync` carries the whole `t_us` before its payload; a
`t16` older than 0.5 s cannot be extended, and its frame is dropped and counted. A message of
more than 6 B is several such frames, with an identifier each; one message comes of them where
their stamps agree.

**Everything else** is cut into segments of 7 B, each with a tail byte behind: bit 7 start, bit 6
end, bit 5 toggle (1 in the first, then alternating), bits 4–0 transfer id. The content is
`version << 4 | flags`, the stamp, the payload; flag bit 3 says that the stamp is the whole `t_us`,
else it is `t16` (where only that makes the content fit one frame). A content of more than 7 B
ends with the CRC-32 of it.
"""

AGREEMENT = """\
## Agreement

Both ends say hello with the hash of their whole catalogue; ours is `{hash:08x}`. Equal hashes: all
is agreed. Otherwise the host asks about each message (`describe` with the number of fields that it
knows), and the device answers with its own number of fields and the chain value after the smaller
of the two.

- Chain: CRC-32 (zlib) of the message's name and a line feed, continued for each field with
  `name|wire|scale|unit` and a line feed; an offset follows its scale with its sign.
- Whole: CRC-32 of the lines `type:chain` (two and eight hexadecimal digits, line feed), in the
  order of types.
- **Chain equal**: what both declare means the same. The shorter side's fields are decoded; those
  that the sender lacks are absent, those that the receiver lacks are passed over and counted. A
  sender leaves out what the other lacks; a device takes a command that ends before its last fields
  from a host that has asked about fewer. Bootstrap messages never change, so a device takes them
  whole whatever was asked.
- **Chain unequal**: the message is disabled, neither sent nor decoded, and the user is told.
- So fields are only ever appended, and an older or a newer peer can be talked to.
"""

AUTHENTICATION = """\
## Authentication

A device may hold a key of 16 B, set with `set_key` over its local UART and never told. From then
on it takes {guarded} only with a tag that its key has made; {free} need none, so that anybody can
stop the robot. What comes without a tag is refused with `not_authenticated`; a cyclic message is
dropped and counted as stale. Hello's capability `authentication` says that a key is set.

With each hello that answers a host, such a device sends `challenge`: a counter, new for each
session. The nonce is `boot_id u32 | session_id u32 | counter u32`, little-endian. A signed
message has the challenge's counter plus 1, the next plus 2, and so on, modulo 2³²; a device takes
one whose counter is ahead of the last it took by less than 2³¹. Tags are HMAC-SHA-256 (RFC 2104)
under the key, cut short.

- **UART**: flag bit 0 in the header, and behind the payload `counter u32 | tag 8 B`, {trailer} B in
  all. The tag covers nonce, header, payload and counter. CRC and COBS go over everything.
- **CAN**: after the last frame of the message one frame of type `{auth_type}`, same node:
  `counter (its low 16 bits) u16 | tag 6 B`. The tag covers the nonce, the message's
  `identifier u16 | length u8 | data` (of a transfer: its whole content, without tail bytes and
  CRC), and the whole counter. The message is acted on when both have come within {together_ms} ms.

A frame of another boot or session never fits, because its nonce is another; one that is played
back in its own session does not, because its counter is behind. Hellos are not signed: whoever
sends one ends the session, and a new session finds the robot standing.

With a key, setpoints are judged as fresh or late by the stamps of signed frames alone, and a frame
that is refused keeps no session alive. A stop is obeyed whatever tag it carries.

Without a key a device has no means to tell a recording from a host: hello, `clear_stop` and
setpoints of a recorded session, played back at its pace, move it, in the same boot or another.
Where others can write to the line, set a key.

"""

RELIABILITY = """\
## Reliability

- **Streams** are not acknowledged; the next one is fresher than a repetition.
- **Setpoints** (`velocity_setpoint`, `wheel_duty`) are cyclic. Each carries a time to live, which
  the device clamps, and a counter that must advance (by 1 to 127, modulo 256). The device keeps the
  smallest (arrival − host stamp) of the session; what a frame is later than that is taken off its
  time to live, and at nothing left it is refused. So a backlog that comes at once moves nothing.
  Stops do not count for the smallest: anyone may send one.
- **Commands** carry an id, are answered with `ack` or `nack`, and are repeated until then. The
  device keeps its last replies by (session, id, type): a repeated command is answered again and not
  carried out again. Ids count up within a session, modulo 65536. The device neither carries out nor
  answers a command whose id is {remembered} or more behind the newest of its session: such a late
  copy cannot be told from a repetition. `stop` is obeyed whatever its id. `get_parameter` and
  `set_parameter` send the `parameter_value` before the `ack`, each time.
- **Stop** is obeyed from anyone at any time, before any question of session, and latched. Causes
  from the least grave to the gravest: {causes}.
  A graver cause replaces the latched one, a less grave one never does, and the device acknowledges
  both. A cause without a name counts as `{unnamed}`. `clear_stop` releases only the cause that it
  names.
- Nothing that a session asked for (mode, stream rates, setpoints) outlives it.
"""

TIMING = """\
## Timing

Every number is the one in the code.
"""

LIFE = """\
## The life of one motor command

The robot drives a lane, and has come to point a little left of it. What happens between that and a
left wheel that turns faster, with where it stands in the code.

1. **Planner** (`bridge.coverage`). It does not steer: it said "drive this heading until the sensor
   says stop" as the lane began, and is asked again only when something happened.
2. **Controllers** (`bridge.motion.control`). At each control period, {control_ms} ms, the leg's
   controllers turn the estimated pose into a wanted velocity: 0.2 m/s ahead, −0.1 rad/s.
3. **Smoothing** (`bridge.motion.control`). A low-pass, then the acceleration limit against the
   last output.
4. **Session** (`bridge.session.session`). Steps of 0.0001 m/s and 0.0002 rad/s, a time to
   live of {ttl_ms} ms, the next counter: the payload `{payload}`.
5. **Queue** (`protocol.link`). A setpoint that still waits is replaced, so there is never more than
   one; where the loop itself was held up by more than {late_ms} ms, nothing old is sent.
6. **Frame** (`protocol.uart.framing`). Header, CRC-32, COBS; {wire_bytes} bytes, {wire_us} µs at
   921 600 baud:

       {wire}

   On CAN it is one frame, identifier 0x{can_id}, data `{can}`: the payload and the short stamp.
7. **Port** (`bridge.io`). Written without blocking; bytes that a stuck port has not taken after
   {stuck_ms} ms are dropped.
8. **Parser** on the device. Bytes gather up to the closing zero; then the length, then the CRC. A
   damaged frame is counted and gone: the next one comes within {control_ms} ms.
9. **Session and mode**. Obeyed only from the agreed session, in velocity mode, with no stop
   latched.
10. **Freshness** (`sim_device.device.safety`). The counter must advance; the extra delay against
    the session's quickest frame is taken off the time to live. Whatever is refused is counted in
    `link_counters.stale`.
11. **Watchdog**. It holds the velocity for what is left, at most {max_ttl_ms} ms. It is not fed by
    anything but setpoints.
12. **Wheel control** (`sim_device.device.wheel_control`), every {tick_ms} ms. The body velocity is
    clamped and ramped at no more than {decel} m/s²; inverse kinematics gives left and right speed;
    each wheel's feed-forward and PI on its encoder gives a duty, scaled by the battery's voltage.
13. **Motor**. The bridge switches, the wheel speeds up, its encoder counts, and within
    {encoders_ms} ms the counts are on their way back in `encoders`, stamped as they were sampled.

**When it ends.** No fresh setpoint within the time to live: ramp to rest and hold, not latched. No
valid frame from the host for {silence_s} s, or a hello of another session: latched, cause `link`.
`stop`: latched at once, until `clear_stop` names the cause that holds.
"""
