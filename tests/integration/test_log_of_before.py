"""A log of version 0.1.0 (revision d183465) is read, verified and computed again, bit for bit, by every later one."""

import json
from pathlib import Path

import pytest
import zstandard

from tests.fakes.command import station

DATA = Path(__file__).parents[1] / "data"
HEAD = "449:b93e7544b64e6fe56cc45f184c2f26bb1399093fe954862a2f9f659da5e7a17c"


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "log.db"
    packed = (DATA / "log-d183465.db.zst").read_bytes()
    path.write_bytes(zstandard.ZstdDecompressor().decompress(packed, max_output_size=1 << 24))
    return path


def test_its_chain_and_signatures_hold(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    key = str(DATA / "log-d183465.pub")
    assert station("audit", "--verify", "--db", str(log), "--key", key, "--head", HEAD, "--json") == 0
    assert json.loads(capsys.readouterr().out)["verify"] == {
        "records": 449, "whole": True, "findings": [], "anchors": [], "acknowledged": [],
        "journal": {"lines": 0, "sealed": 0},
        "accounts": None,
    }  # fmt: skip


def test_every_calibration_but_its_budget_comes_out_again_bit_for_bit(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert station("audit", "--recompute", "--db", str(log), "--json") == 0
    shown = json.loads(capsys.readouterr().out)["recompute"]
    assert sorted(r["compared"] for r in shown) == [0, 130, 130, 130, 130, 358, 1384]
    assert all(r["identical"] for r in shown)
