"""The tour, and the folder it leaves: examples of the helps run there as they stand, in any order.

What takes long is tried by tests/endurance/help_examples.py, with every block of every guide; what needs a plant, by
tests/plant.
"""

import contextlib
import io
import random
import re
import shutil
from itertools import pairwise
from pathlib import Path

import pytest

from station.cli import _demo
from station.cli.app import run_command
from station.errors import UsageError
from tests.conftest import SEED
from tests.fakes.help_examples import (
    GUIDES,
    SCREEN,
    Tried,
    all_documented,
    badly_laid_out,
    guide_examples,
    needs_person,
    needs_plant,
    serves,
    try_example,
    words_of,
)
from tests.portion import one_of_each

pytestmark = pytest.mark.timeout(600)

#: Beginnings of examples that take seconds each; the endurance program runs them too.
SLOW = (
    "station msa type1",
    "station msa grr --serial",
    "station msa bias",
    "station diagnose",
    "station check tilt-24",
    "station check six-point --design",
    "station run --simulate",
    "station init",
    "station line",
    "station rig check",
    "station rig axes",
    "station run --config drives.yaml",
)
#: What follows one of these is written, and there from then on.
WRITES = ("--out", "--frames", "--json", "--report", "--extend", "--next-run", "--correct", "--svg", "--bundle")
#: Endings of files that an example may read.
READ = {".csv", ".txt", ".mat", ".log", ".blf", ".asc", ".mf4", ".parquet", ".dbc", ".eds", ".zip"}
#: A narrow screen: half of one, or a phone.
NARROW = 60
#: Guides whose blocks take a few seconds in all; the endurance program runs every guide's.
GUIDES_TRIED = ("bench-in-15-minutes", "good-calibration", "watch")


@pytest.fixture(scope="module")
def tour(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder, and what the tour showed."""
    folder = tmp_path_factory.mktemp("tour") / "station-demo"
    shown = io.StringIO()
    with contextlib.redirect_stdout(shown):
        assert run_command(["demo", str(folder)]) == 0
    return folder, shown.getvalue()


def test_the_tour_shows_passes_fails_a_named_cause_and_a_whole_log(tour: tuple[Path, str]) -> None:
    _, shown = tour
    assert all(f"\n{n}. " in shown for n in range(1, len(_demo.TOUR) + 1))
    assert len(re.findall("✔ PASS", shown)) == 9
    assert re.search(r"SN9002 .*FAIL", shown)
    assert re.search(r"SN0044 .*ERROR", shown)
    assert "verdict: named. Found: cross-axis." in shown
    assert "is whole" in shown


def test_a_folder_with_something_in_it_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(UsageError, match=f"The folder {tmp_path} is not empty"):
        run_command(["demo", str(tmp_path)])
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]


def test_every_file_that_a_guide_reads_is_there_or_was_written_by_a_line_before(tour: tuple[Path, str]) -> None:
    missing = []
    for page in GUIDES:
        there = {path.relative_to(tour[0]).as_posix() for path in tour[0].rglob("*")}
        for line in filter(lambda line: not needs_plant(line), guide_examples(page)):
            words = words_of(line)
            writes = (*WRITES, "--samples") if words[1] == "export" else WRITES
            written = {after for option, after in pairwise(words) if option in writes and after not in there}
            files = {word for word in words[2:] if Path(word).suffix in READ}
            missing += [f"{page.name}: {line}: {file}" for file in files - written - there]
            there |= written
    assert missing == []


def test_every_quick_example_runs_there_in_any_order(
    tour: tuple[Path, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(tour[0], folder)
    monkeypatch.chdir(folder)
    monkeypatch.setattr("sys.stdin", io.StringIO())
    monkeypatch.setenv("COLUMNS", str(SCREEN))
    lines = all_documented()
    assert all(any(line.startswith(start) for line in lines) for start in SLOW[:-1]), "SLOW names what is no example"
    quick = [
        line for line in lines if not (line.startswith(SLOW) or needs_plant(line) or needs_person(line) or serves(line))
    ]
    assert len(quick) > 35
    random.Random(SEED).shuffle(quick)
    for line in quick:
        code = run_command(words_of(line)[1:])
        shown = capsys.readouterr()
        tried = Tried(line, code, shown.err, shown.out)
        assert tried.right, tried


def test_every_example_that_serves_starts_and_ends_by_ctrl_c(tour: tuple[Path, str], tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(tour[0], folder)
    lines = [line for line in all_documented() if serves(line) and not needs_plant(line)]
    assert len(lines) >= 9
    for line in one_of_each(lines, lambda line: line.split()[1]):
        tried = try_example(line, folder)
        assert tried.right, tried


@pytest.mark.parametrize("name", GUIDES_TRIED)
def test_the_blocks_of_a_guide_run_in_their_order(
    name: str,
    tour: tuple[Path, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (page,) = (page for page in GUIDES if page.stem == name)
    folder = tmp_path / "copy"
    shutil.copytree(tour[0], folder)
    monkeypatch.chdir(folder)
    monkeypatch.setattr("sys.stdin", io.StringIO())
    monkeypatch.setenv("COLUMNS", str(NARROW))
    for line in guide_examples(page):
        code = run_command(words_of(line)[1:])
        shown = capsys.readouterr()
        tried = Tried(line, code, shown.err, shown.out)
        assert tried.right, tried
        assert not badly_laid_out(line, tried.output, NARROW)
