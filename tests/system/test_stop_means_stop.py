"""A real process, a fixture that takes real time: whatever stops it, it is parked and the record is true."""

import os
import pty
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.fakes.fixture_run import Ran
from tests.fakes.waiting import until

ROOT = Path(__file__).parents[2]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen[bytes]]]:
    """Starts the run; what is still there at the end is killed."""
    running: list[subprocess.Popen[bytes]] = []

    def begin(**options: object) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "tests.fakes.slow_fixture", str(tmp_path)]
        running.append(subprocess.Popen(command, cwd=ROOT, **options))  # type: ignore[call-overload]
        return running[-1]

    yield begin
    for process in running:
        process.kill()
        process.wait()


def wait_for(folder: Path, deed: str, times: int = 1) -> None:
    """Until the fixture has begun or ended that deed so often."""
    until(lambda: actions(folder).count(deed) >= times, f"{deed}, {times} times")


def actions(folder: Path) -> list[str]:
    path = folder / "deeds"
    return path.read_text().splitlines() if path.exists() else []


def check_parked_and_true(folder: Path) -> None:
    ran = Ran(folder)
    assert actions(folder)[-2:] == ["parking", "parked"]
    assert ran.life("SN0001")["outcome"] == "ABORTED"
    assert ran.memory("SN0001") == {}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_stop_breaks_off_the_move_and_no_further_one_skips_parking(
    tmp_path: Path, start: Callable[..., "subprocess.Popen[bytes]"], number: signal.Signals
) -> None:
    process = start(stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    wait_for(tmp_path, "moving", 2)
    process.send_signal(number)
    wait_for(tmp_path, "parking")
    for _ in range(10):
        process.send_signal(signal.SIGINT)
        time.sleep(0.02)
    _, shown = process.communicate(timeout=60)
    assert process.returncode == 4, shown
    assert b"Traceback" not in shown
    assert actions(tmp_path).count("moved") == 1, "the second move was broken off"
    check_parked_and_true(tmp_path)


def test_the_pages_stop_reaches_a_run_in_the_background_of_a_script(
    tmp_path: Path, start: Callable[..., "subprocess.Popen[bytes]"]
) -> None:
    """A shell without job control starts its background commands with SIGINT ignored, and so do their children."""

    def ignore() -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)

    process = start(stdout=subprocess.PIPE, stderr=subprocess.PIPE, preexec_fn=ignore)
    wait_for(tmp_path, "moving", 2)
    process.send_signal(signal.SIGINT)
    _, shown = process.communicate(timeout=60)
    assert process.returncode == 4, shown
    check_parked_and_true(tmp_path)


def test_an_operator_terminal_that_dies_parks_the_fixture(
    tmp_path: Path, start: Callable[..., "subprocess.Popen[bytes]"]
) -> None:
    ours, theirs = pty.openpty()

    def lead() -> None:
        os.setsid()
        os.close(os.open(os.ttyname(1), os.O_RDWR))  # the first terminal a session leader opens is its own

    process = start(stdin=theirs, stdout=theirs, stderr=theirs, preexec_fn=lead)
    os.close(theirs)
    wait_for(tmp_path, "moving", 2)
    os.close(ours)
    process.wait(60)
    check_parked_and_true(tmp_path)


def test_readers_that_go_away_stop_nothing_before_the_end(
    tmp_path: Path, start: Callable[..., "subprocess.Popen[bytes]"]
) -> None:
    process = start(stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    assert process.stdout is not None
    wait_for(tmp_path, "moving", 2)
    process.stdout.close()
    process.wait(100)
    assert actions(tmp_path)[-1] == "parked"
    assert Ran(tmp_path).life("SN0001")["outcome"] == "PASS"
