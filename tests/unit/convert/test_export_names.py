"""File names for exported topics, because a topic's name may be any text."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import Writer

from bridge.convert.export import export
from bridge.convert.table_names import table_names
from bridge.errors import OutputExistsError
from support.cli import sweepctl

if TYPE_CHECKING:
    from pathlib import Path

ODD = [
    "/device/imu", "/Device/IMU", "/device.imu", "/device imu", "../../etc/passwd", "/..", "..",
    "", "/", "/con", "/NUL.txt", "/-rf", "/a\x00b", "/\x1b]0;title\x07", "/é", "/e\u0301",
    "/" + "ü" * 3000, "/" + "x" * 5000, "/" + "x" * 5000 + "y", "/com1", "/\u017f", "/s",
]  # fmt: skip


def log_of(path: Path, topics: list[str]) -> Path:
    file = io.BytesIO()
    writer = Writer(file)
    writer.start()
    for topic in topics:
        channel = writer.register_channel(topic, "json", 0)
        writer.add_message(channel, 1, b"{}", 1, 1)
    writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it unannotated
    path.write_bytes(file.getvalue())
    return path


def test_every_topic_has_its_own_table_in_the_folder(tmp_path: Path) -> None:
    log = log_of(tmp_path / "odd.mcap", ODD)
    out = tmp_path / "tables"
    result = export(log, out)
    assert set(result.files) == set(ODD)
    found = sorted(path.name for path in out.iterdir())
    assert len({name.casefold() for name in found}) == len(ODD)
    for topic, file in result.files.items():
        assert file.parent == out
        table = pq.read_table(file)
        assert table.schema.metadata[b"sweepctl.topic"].decode() == topic
    assert sorted(tmp_path.iterdir()) == sorted([log, out]), "nothing outside of it"


@given(st.lists(st.text(max_size=400), unique=True, max_size=20))
def test_names_are_short_safe_and_unique(topics: list[str]) -> None:
    names = table_names(topics)
    assert names == table_names(reversed(topics))
    assert len({name.casefold() for name in names.values()}) == len(topics)
    for name in names.values():
        assert len(f"{name}.parquet".encode("utf-8", "surrogatepass")) <= 255
        assert name.isprintable() or not name.isascii()
        assert not {"/", "\\", ":", "\0", "\n"} & set(name)
        assert not name.startswith((".", "-"))


def test_a_table_that_exists_is_reported_before_any_is_written(tmp_path: Path) -> None:
    log = log_of(tmp_path / "three.mcap", ["/a", "/b", "/c"])
    out = tmp_path / "tables"
    out.mkdir()
    (out / "b.parquet").write_text("kept")
    done = sweepctl("export", log, "--out", out)
    assert done.status == 1
    assert "b.parquet exists; give another name, or --force to replace it" in done.line
    assert [path.name for path in out.iterdir()] == ["b.parquet"]
    assert (out / "b.parquet").read_text() == "kept"
    assert sweepctl("export", log, "--out", out, "--topic", "/a").status == 0
    (out / "a.parquet").unlink()
    assert sweepctl("export", log, "--out", out, "--force").status == 0
    assert len(list(out.iterdir())) == 3


def test_a_log_without_a_summary_works_too(tmp_path: Path) -> None:
    log = log_of(tmp_path / "three.mcap", ["/a", "/b", "/c"])
    data = log.read_bytes()
    log.write_bytes(data[: data.rfind(b"\x0f\x04\0\0\0\0\0\0\0")])
    out = tmp_path / "tables"
    out.mkdir()
    (out / "c.csv").symlink_to("nowhere")
    with pytest.raises(OutputExistsError):
        export(log, out, file_format="csv")
    assert [path.name for path in out.iterdir()] == ["c.csv"]
    assert not (tmp_path / "nowhere").exists()
