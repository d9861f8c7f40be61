"""`station rig check`: what is wrong with a mounting is found by gravity, and said."""

import json
from pathlib import Path

import numpy as np
import pytest

from station.cli.app import main
from station.domain.rig.rig_map import RigMap
from station.service.rig_check import slow
from tests.fakes.mountings import Mounting, drawn, wrong


@pytest.mark.parametrize("seed", [1])
def test_random_mountings_are_seen_through(seed: int) -> None:
    """All hundred of them: benchmarks/rig.py."""
    mounting = drawn(np.random.default_rng(seed))
    assert wrong(mounting, seed) == [], mounting


def test_a_right_mounting_is_called_right() -> None:
    assert wrong(Mounting(False, (False, False), (1.0, 1.0), (0.0, 0.0)), 7) == []


def test_commissioning_is_slow(tmp_path: Path) -> None:
    from station.config.rigs import load_rig

    rig: RigMap = slow(load_rig("two-axis"), 10.0)
    assert [axis.speed_deg_s for axis in rig.axes] == [10.0, 10.0]
    assert rig.space.hop_s((0.0, 0.0), (90.0, 0.0)) > 9.0


def command(capsys: pytest.CaptureFixture[str], *args: str) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command."""
    with pytest.raises(SystemExit) as ended:
        main(["rig", *args])
    out, err = capsys.readouterr()
    return int(ended.value.code or 0), out, err


def test_the_command_checks_a_simulated_rig_that_is_built_the_other_way(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "config.yaml"
    drives = "{kind: cia402, map: two-axis, interface: udp_multicast, channel: 239.74.163.2}"  # not of the bench
    config.write_text(f"nests: [{{name: A, node: 17}}]\npositioner: {drives}\n")
    built, corrected = tmp_path / "built.yaml", tmp_path / "corrected.yaml"
    shipped = (Path(__file__).parents[2] / "rigs" / "two-axis.yaml").read_text()
    built.write_text(shipped.replace("counts_per_deg: 1000", "counts_per_deg: -1000", 1))
    options = ("--config", str(config), "--bench", "--mounted", str(built), "--correct", str(corrected))
    code, out, _ = command(capsys, "check", "--speed", "90", "--json", *options)
    document = json.loads(out)
    assert code == 1
    assert document["schema"] == "station.rig-check/1"
    assert [m["id"] for m in document["messages"]] == ["rig-axis-backwards"]
    assert "counts_per_deg: -1000" in corrected.read_text()


@pytest.mark.parametrize(
    ("args", "sentence"),
    [
        (("turn",), "There is no `station rig turn`"),
        (("--simulate", "plotter"), "'plotter'"),
        (("check", "--mounted", "x.yaml"), "--mounted"),
        (("--simulate", "cia402", "--map", "no-such-rig"), "no-such-rig"),
        (("--simulate", "cia402", "--fault", "gremlins"), "no drive fault `gremlins`"),
    ],
)
def test_wrong_command_lines_get_one_sentence(
    capsys: pytest.CaptureFixture[str], args: tuple[str, ...], sentence: str
) -> None:
    code, out, err = command(capsys, *args)
    assert (code, out) == (2, "")
    assert sentence in err
    assert len(err.strip().splitlines()) == 1


def test_a_positioner_by_hand_cannot_be_commissioned(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "config.yaml"
    config.write_text("nests: [{name: A, node: 17}]\n")
    code, _, err = command(capsys, "check", "--bench", "--config", str(config))
    assert code == 2
    assert "positioner.kind is manual" in err
