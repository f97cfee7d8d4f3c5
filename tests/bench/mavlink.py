"""MAVLink 2 with pymavlink and fastcrc, for a comparison with our protocol.

Besides the standard message ``RAW_IMU``, the benchmark uses a dialect with one message, which
pymavlink's generator makes. It has the content of our IMU message, so that both protocols carry the
same values.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import tempfile
from pathlib import Path
from typing import Any

import fastcrc  # noqa: F401 - without it pymavlink uses its slow CRC in Python
from pymavlink.generator import mavgen

_FIELDS = ("accel_x", "accel_y", "accel_z", "temperature", "gyro_x", "gyro_y", "gyro_z")
_DIALECT = """<?xml version="1.0"?>
<mavlink><version>3</version><dialect>0</dialect><messages>
<message id="200" name="SWEEPER_IMU"><description>stamp and seven registers</description>
<field type="uint32_t" name="time_us">stamp</field>
{fields}
</message></messages></mavlink>
"""


def same_content() -> Any:  # noqa: ANN401 - a generated module
    """Make the dialect of one message: a 32-bit stamp and seven 16-bit registers."""
    rows = "\n".join(f'<field type="int16_t" name="{n}">register</field>' for n in _FIELDS)
    with tempfile.TemporaryDirectory() as folder:
        source, made = Path(folder) / "sweeper.xml", Path(folder) / "sweeper_dialect.py"
        source.write_text(_DIALECT.format(fields=rows))
        options = mavgen.Opts(str(made), wire_protocol="2.0", language="Python3", validate=False)
        with contextlib.redirect_stdout(io.StringIO()):
            mavgen.mavgen(options, [str(source)])
        spec = importlib.util.spec_from_file_location("sweeper_dialect", made)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    return module


def parse_all(dialect: Any, reads: list[bytes]) -> int:  # noqa: ANN401 - a generated module
    """Feed reads to ``parse_buffer``; return the number of messages."""
    parser = dialect.MAVLink(None)
    parser.robust_parsing = True
    return sum(len(parser.parse_buffer(data) or ()) for data in reads)
