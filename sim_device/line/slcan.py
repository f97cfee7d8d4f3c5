"""Model of a serial CAN adapter with the LAWICEL protocol: converts text lines to frames and back.

The module has no I/O. A command ends with CR. The answer is the requested value and CR, or BELL for
an invalid command. A frame is passed as the 16 bytes of :data:`protocol.can.frames.RECORD`.
"""

from __future__ import annotations

from protocol.can.frames import RECORD

OK, BELL = b"\r", b"\a"
BITRATES = {
    b"S0": 10_000,
    b"S1": 20_000,
    b"S2": 50_000,
    b"S3": 100_000,
    b"S4": 125_000,
    b"S5": 250_000,
    b"S6": 500_000,
    b"S7": 800_000,
    b"S8": 1_000_000,
}
VERSION, SERIAL = b"V1013", b"NSW01"
BUS_ERROR = 0x80
"""Status flag of a bus error."""
SHORTEST_LINE = 6
"""Minimum length of a line with a frame, characters: a standard frame without data (``t1230`` and
CR)."""
LONGEST_LINE = 32
"""Maximum length of a line, characters. An extended frame with 8 bytes and a time stamp has 30."""
_EXTENDED, _REMOTE, _FLAGS = 0x8000_0000, 0x4000_0000, 0xE000_0000
_KINDS = {b"t": (3, 0), b"T": (8, _EXTENDED), b"r": (3, _REMOTE), b"R": (8, _EXTENDED | _REMOTE)}
"""Number of identifier digits and flags for each frame command."""
_LIMITS = {3: 0x7FF, 8: 0x1FFF_FFFF}
_MAX_LENGTH = 8


class SlcanAdapter:
    """One adapter between a host's serial port and a CAN bus."""

    def __init__(self, bus_bitrate: int = 500_000) -> None:
        self.is_open = False
        self.listens_only = False
        self._bus_bitrate = bus_bitrate
        self._bitrate = bus_bitrate
        self._flags = 0
        self._line = b""
        self._overlong = False

    def feed(self, data: bytes) -> tuple[bytes, bytes]:
        """Process bytes from the serial port; return frames for the bus, and the answer."""
        records: list[bytes] = []
        answers: list[bytes] = []
        lines = (self._line + data).split(OK)
        self._line = lines.pop()
        for line in lines:
            too_long, self._overlong = self._overlong or len(line) > LONGEST_LINE, False
            answers.append(BELL if too_long else self._command(line, records))
        if len(self._line) > LONGEST_LINE:
            self._line, self._overlong = b"", True
        return b"".join(records), b"".join(answers)

    def _command(self, line: bytes, records: list[bytes]) -> bytes:  # noqa: PLR0911 - one for each
        match line[:1]:
            case b"":
                return OK
            case b"S" if line in BITRATES and not self.is_open:
                self._bitrate = BITRATES[line]
                return OK
            case b"O" | b"L" if len(line) == 1 and not self.is_open:
                self.is_open = True
                self.listens_only = line == b"L"
                return OK
            case b"C" if len(line) == 1 and self.is_open:
                self.is_open = False
                return OK
            case b"V" if len(line) == 1:
                return VERSION + OK
            case b"N" if len(line) == 1:
                return SERIAL + OK
            case b"F" if len(line) == 1 and self.is_open:
                flags, self._flags = self._flags, 0
                return b"F%02X" % flags + OK
            case b"t" | b"T" | b"r" | b"R":
                return self._transmit(line, records)
            case _:
                return BELL

    def _transmit(self, line: bytes, records: list[bytes]) -> bytes:
        record = parse_frame(line)
        if record is None or not self.is_open or self.listens_only:
            return BELL
        if self._bitrate != self._bus_bitrate:
            self._flags |= BUS_ERROR  # no node acknowledges the frame
            return BELL
        records.append(record)
        return OK

    def from_bus(self, records: bytes) -> bytes:
        """Convert frames of the bus to lines for the host."""
        if not self.is_open or not records:
            return b""
        if self._bitrate != self._bus_bitrate:
            self._flags |= BUS_ERROR
            return b""
        return b"".join(
            format_frame(records[i : i + RECORD.size]) for i in range(0, len(records), RECORD.size)
        )


def parse_frame(line: bytes) -> bytes | None:
    """Convert a line such as ``tIIILDD…`` to a 16-byte record; None if the line is invalid."""
    digits, flags = _KINDS[line[:1]]
    head, rest = line[1 : 2 + digits], line[2 + digits :]
    try:
        can_id, length = int(head[:digits], 16), int(head[digits:])
        data = bytes.fromhex(rest.decode("ascii"))
    except (ValueError, UnicodeDecodeError):
        return None
    wanted = 0 if flags & _REMOTE else length
    if can_id > _LIMITS[digits] or length > _MAX_LENGTH or len(rest) != 2 * wanted:
        return None
    return RECORD.pack(can_id | flags, length, data)


def format_frame(record: bytes) -> bytes:
    """Convert a 16-byte record to the line that an adapter sends, without a time stamp."""
    word, length, data = RECORD.unpack(record)
    extended, remote = bool(word & _EXTENDED), bool(word & _REMOTE)
    kind = ("R" if extended else "r") if remote else ("T" if extended else "t")
    can_id = f"{word & ~_FLAGS:0{8 if extended else 3}X}"
    content = "" if remote else data[:length].hex().upper()
    return f"{kind}{can_id}{length}{content}".encode() + OK
