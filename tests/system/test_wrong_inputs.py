"""Wrong files and command lines: one sentence of ours that names the file, the right exit code, never an exception.

A small share of each kind; tests/endurance/wrong_inputs.py tries 200 of every command.
"""

import io
import random
import shlex
from pathlib import Path

import pytest

from station.config.search_path import shipped_folder
from tests.conftest import SEED
from tests.fakes.command import captured
from tests.fakes.wrong_inputs import FILES, WrongInput, all_commands, complaint, wrong_files, wrong_lines

EACH = 9


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, and nobody at the keyboard."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin", io.StringIO())
    return tmp_path


@pytest.mark.parametrize("kind", FILES)
def test_wrong_files(kind: str, here: Path) -> None:
    found = [complaint(w) for w in wrong_files(kind, here, random.Random(f"{SEED}{kind}"), EACH)]
    assert [c for c in found if c is not None] == []


def test_wrong_command_lines(here: Path) -> None:
    rng = random.Random(SEED)
    found = [complaint(w) for name in all_commands() for w in wrong_lines(name, rng, 3)]
    assert len(found) > 70
    assert [c for c in found if c is not None] == []


#: A rehearsal bench.
_REHEARSAL = """schema: station.config/1
station: bench
bus: {interface: simulated}
nests: [{name: A, node: 17}]
rehearsal: {device_state: devices}
"""


@pytest.mark.parametrize(
    "line",
    [
        "diagnose --samples s.csv --recipe six-point --report ''",
        "simulate --recipe six-point --unit-spread nan --out s.csv",
        "msa grr --samples readings.csv --tolerance 1e400",
        "rig --simulate plc --loads 1 --memory other.json",
        "msa grr --samples readings.csv --tolerance -1",
        "audit --since 2026-11-24 --until 2026-11-20",
        "run six-point --units 1",
        "run --recipe six-point --units 1 --interface can0",
        "run --recipe six-point --units 1 --config typo.yaml",
        "calibrate --recipe six-point --samples .",
        "line --simulate --loads 1 --device-state readings.csv",
        "device --interface virtual --channel here --node 17 --serial 99999999999999999999",
        "check --product product.yaml",
        "check recipe.yaml",
        "panel --simulate --db readings.csv --port 0",
        "audit --db loop.db",
        "run --simulate --units 1 --db loop.db",
        "panel --simulate --port 0 --db loop.db",
        "stop --db loop.db",
        "watch --db typo.yaml",
        "audit --db .",
        "audit --verify --key nowhere.pem",
        "import . --out s.csv",
        "effects --into here",
        "golden trend SN0001 --due 2035-06-30",
        "key rotate --to new.key --reason stolen",
        "rig --simulate plc --since 7d",
        "rig check --bench --loads 3",
        "plant register bench-1 --key readings.csv --config plant.yaml",
        "msa type1 --serial SN0001/2 --repeats 5 --reference 0.1 --simulate --db new.db",
        "run --simulate --serial SN1/2 --db new.db",
    ],
)
def test_what_a_newcomer_types(line: str, here: Path) -> None:
    Path("other.json").write_text('{"schema": "station.golden/1"}')
    Path("typo.yaml").write_text(_REHEARSAL.replace("interface:", "interfce:"))
    Path("readings.csv").write_text("part,appraiser,trial,value\n" + "1,A,1,0.1\n" * 8)
    Path("plant.yaml").write_text('schema: station.plant/1\ndatabase: "postgresql:///plant"\n')
    shipped = shipped_folder()
    Path("product.yaml").write_text((shipped / "dbc/accelerometer.yaml").read_text().replace("accelerometer.", "0b1."))
    Path("recipe.yaml").write_text(
        (shipped / "recipes/six-point.yaml").read_text().replace("product: accelerometer", "product: 0b1")
    )
    Path("loop.db").symlink_to("loop.db")
    words, before = shlex.split(line), set(here.iterdir())
    named = next((word for word in words if word in ("product.yaml", "recipe.yaml")), "")
    assert complaint(WrongInput("line", tuple(words), named)) is None
    assert captured(*words).returncode == 2
    assert set(here.iterdir()) == before
