"""Samples tables that nothing can be told from: one sentence, never a traceback, never a name."""

import json
from pathlib import Path

import numpy as np
import pytest

from station.cli.app import main

UP = {"z-up": (0, 0, 1), "z-down": (0, 0, -1), "x-up": (1, 0, 0), "x-down": (-1, 0, 0), "y-up": (0, 1, 0)}
HEAD = "unit,run,visit,position,time_s,x,y,z"


def table(path: Path, positions: list[str], rows: int, noise_g: float, rng: np.random.Generator) -> Path:
    lines = [HEAD]
    for visit, name in enumerate(positions):
        for k in range(rows):
            x, y, z = np.array(UP[name]) + noise_g * rng.standard_normal(3)
            lines.append(f"A,0,{visit},{name},{2 * visit + 0.01 * k:.2f},{x},{y},{z}")
    path.write_text("\n".join(lines) + "\n")
    return path


def diagnosed(path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    with pytest.raises(SystemExit) as ended:
        main(["diagnose", "--recipe", "six-point", "--samples", str(path), "--json", "-"])
    out, err = capsys.readouterr()
    return int(str(ended.value.code)), out or err


@pytest.mark.parametrize(
    ("positions", "rows", "noise_g", "words"),
    [(["z-up"], 100, 1e-3, "nothing can be told from one stop"), (["z-up"] * 3, 1, 0.0, "the same in every row")],
)
def test_too_little_is_one_sentence(
    positions: list[str],
    rows: int,
    noise_g: float,
    words: str,
    tmp_path: Path,
    rng: np.random.Generator,
    capsys: pytest.CaptureFixture[str],
) -> None:
    code, told = diagnosed(table(tmp_path / "few.csv", positions, rows, noise_g, rng), capsys)
    assert code == 2
    assert words in told
    assert told.count("\n") == 1


@pytest.mark.parametrize(("positions", "rows"), [(list(UP)[:2], 100), (list(UP), 1), (list(UP), 3)])
def test_little_more_names_nothing_and_says_what_it_could_not_test(
    positions: list[str], rows: int, tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    code, told = diagnosed(table(tmp_path / "little.csv", positions, rows, 1e-3, rng), capsys)
    document = json.loads(told)
    assert (code, document["verdict"], document["causes"]) == (0, "none", [])
    assert {"offset-temperature", "motor-tone"} <= set(document["not_testable"])
