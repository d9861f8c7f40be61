"""A recording that is read with a DBC holds frames: its reader is asked first, that of signals where it finds none."""

from pathlib import Path

import pytest

from station.domain.recognition.raw_table import RawTable
from station.errors import LogError, UsageError
from station.wiring import raw_tables as wired

TABLE = RawTable("x.mf4", ())


def asked(path: Path, monkeypatch: pytest.MonkeyPatch, frames: list[RawTable] | None) -> list[str]:
    """Which readers were asked for a file that holds these, or no frames but signals."""
    called = []

    def of_frames(path: Path, dbc: Path) -> list[RawTable]:
        called.append("frames")
        if frames is None:
            raise LogError("recording-without-frames", file=str(path))
        return frames

    def signals(path: Path) -> list[RawTable]:
        called.append("signals")
        return [TABLE]

    monkeypatch.setattr(wired, "_of_frames", of_frames)
    monkeypatch.setattr(wired, "read_tables", signals)
    path.write_bytes(b"MDF     ")
    if frames is None:
        with pytest.raises(UsageError, match="frames"):
            wired.raw_tables(path, path)
    else:
        assert wired.raw_tables(path, path) == frames
    return called


def test_frames_are_read_once_and_no_signals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert asked(tmp_path / "x.mf4", monkeypatch, [TABLE]) == ["frames"]


def test_signals_with_a_dbc_are_said_to_be_none_of_its_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert asked(tmp_path / "x.mf4", monkeypatch, None) == ["frames", "signals"]
