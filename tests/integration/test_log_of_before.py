"""A log of version 0.1.0 (revision d183465) is read, verified and computed again, bit for bit, by every later one."""

import json
import os
import subprocess
import sys
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


#: OpenBLAS' name of the arithmetic that the log was made with, and the instructions that it needs.
KERNELS, INSTRUCTIONS = "SkylakeX", {"avx512f", "avx512dq", "avx512bw", "avx512vl"}


def test_every_calibration_but_its_budget_comes_out_again(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Bit for bit where the kernels of before can run; on every processor within its rounding."""
    assert station("audit", "--recompute", "--db", str(log), "--json") == 0
    shown = json.loads(capsys.readouterr().out)["recompute"]
    assert sorted(r["compared"] for r in shown) == [0, 130, 130, 130, 130, 358, 1384]
    assert all(r["agrees"] for r in shown)


def test_it_comes_out_bit_for_bit_by_the_same_arithmetic(log: Path) -> None:
    if not set(Path("/proc/cpuinfo").read_text().split()) >= INSTRUCTIONS:
        pytest.skip(f"this processor cannot run the kernels of the log, {KERNELS}")
    command = [sys.executable, "-m", "station", "audit", "--recompute", "--db", str(log), "--json"]
    done = subprocess.run(command, env=os.environ | {"OPENBLAS_CORETYPE": KERNELS}, capture_output=True, check=True)
    assert all(r["identical"] for r in json.loads(done.stdout)["recompute"])
