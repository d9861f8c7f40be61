"""The operator's stop on a wire: from the signal to the frame, by the time stamps of a listener that is nobody's part.

Four processes share a CAN over UDP multicast: the drives (`station rig --simulate cia402`), a station that turns them
to and fro, a listener whose kernel stamps every frame as it comes, and this one, which sends the signal in mid-move.
"""

import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from station.adapters.clock import SystemClock
from station.adapters.positioner.cia402 import Cia402Positioner
from station.cli._stop_signals import stop_signals
from station.config.rigs import load_rig
from station.domain.rig import drive_profile as profile
from station.errors import Aborted, PositionerFault
from station.service.stop_request import StopRequest
from station.wiring.buses import named_bus, open_interface
from tests.fakes.driven_rig import visit

CHANNEL = "239.74.163.77"
#: A move may end by itself: so many are begun for each stop at most.
MOST_TRIES = 3
SYNC, COMMANDS = 0x080, (0x201, 0x301)
#: The longest that anything here is waited for, s.
PATIENCE_S = 30.0
#: A drive that misses the station so long stops by itself. More than on a bench: drives and station share their cores
#: with whatever else runs here, and what is measured is the stop that the station commands.
WATCHDOG_S = 2.0


@dataclass(frozen=True, slots=True)
class Heard:
    """One frame as the listener's kernel stamped it, s since 1970."""

    at_s: float
    can_id: int
    data: bytes


def listen() -> None:
    """Prints every frame; a process of its own."""
    import can

    with can.Bus(interface="udp_multicast", channel=CHANNEL) as bus:
        print("ready", flush=True)
        for frame in bus:
            print(json.dumps([frame.timestamp, frame.arbitration_id, frame.data.hex()]), flush=True)


def turn() -> None:
    """Turns to and fro until its standard input ends; a signal stops the present move, as in `station run`."""
    clock, stop = SystemClock(), StopRequest()
    bus = open_interface(named_bus("udp_multicast", CHANNEL), clock)
    rig = load_rig("two-axis").model_copy(update={"watchdog_s": WATCHDOG_S})
    positioner = Cia402Positioner(Cia402Positioner.Settings(channel=CHANNEL), clock, bus, rig)
    ups = ("-y", "+x")
    with stop_signals(stop):
        print("ready", flush=True)
        for number, _ in enumerate(sys.stdin):
            stop.requested = False
            try:
                with stop:
                    positioner.move(visit(ups[number % 2]), 60.0)
            except Aborted:
                print("stopped", flush=True)
            except PositionerFault as fault:
                print(fault.message.id, flush=True)
            else:
                print("arrived", flush=True)
        positioner.park(60.0)
    positioner.close()
    bus.close()


def measured(stops: int, seed: int) -> tuple[list[float], int]:
    """Seconds from the signal to the SYNC that latches the quick stop, of each stop; and at how many stops one SYNC
    latched it for both axes."""
    rng = np.random.default_rng(seed)
    here = [sys.executable, __file__]
    rig = [sys.executable, "-m", "station", "rig", "--simulate", "cia402", "--interface", "udp_multicast"]
    taken: list[float] = []
    together = 0
    with (
        _running([*here, "listen"]) as listener,
        _running([*rig, "--channel", CHANNEL]) as drives,
        _running([*here, "turn"]) as station,
    ):
        frames = _heard(listener)
        _line(drives)  # what it simulates, as soon as it does
        _line(station)
        for _ in range(MOST_TRIES * stops):
            stopped = _one_stop(station, frames, rng.uniform(0.05, 0.4))
            if stopped is not None:
                taken.append(stopped[0])
                together += stopped[1]
            if len(taken) == stops:
                break
    return taken, together


def _one_stop(station: subprocess.Popen[str], frames: "queue.Queue[Heard]", wait_s: float) -> tuple[float, bool] | None:
    """A move, and the signal so long after its set-point went out; None where the move ended by itself before."""
    assert station.stdin is not None
    station.stdin.write("move\n")
    station.stdin.flush()
    while not _is_command(frame := frames.get(timeout=PATIENCE_S), profile.ENABLE | profile.START):
        continue
    time.sleep(max(0.0, frame.at_s + wait_s - time.time()))
    asked_s = time.time()
    os.kill(station.pid, signal.SIGINT)
    ended = _line(station)
    if ended != "stopped":
        print(f"  a move ended with {ended} before it was stopped")
        return None
    stopping: set[int] = set()
    while (frame := frames.get(timeout=PATIENCE_S)).can_id != SYNC or not stopping:
        if frame.at_s >= asked_s and _is_command(frame, profile.QUICK_STOP):
            stopping.add(frame.can_id)
    return frame.at_s - asked_s, stopping == set(COMMANDS)


def _is_command(frame: Heard, word: int) -> bool:
    return frame.can_id in COMMANDS and int.from_bytes(frame.data[:2], "little") == word


@contextmanager
def _running(command: list[str]) -> Iterator[subprocess.Popen[str]]:
    """A process, until its standard input ends; one that does not end by that is terminated."""
    process = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        assert process.stdin is not None
        process.stdin.close()
        try:
            process.wait(2.0)
        except subprocess.TimeoutExpired:
            process.terminate()
            process.wait(PATIENCE_S)


def _heard(listener: subprocess.Popen[str]) -> "queue.Queue[Heard]":
    """Every frame from now on."""
    _line(listener)
    frames: queue.Queue[Heard] = queue.Queue()

    def pump() -> None:
        assert listener.stdout is not None
        for line in listener.stdout:
            at_s, can_id, data = json.loads(line)
            frames.put(Heard(at_s, can_id, bytes.fromhex(data)))

    threading.Thread(target=pump, daemon=True).start()
    return frames


def _line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


if __name__ == "__main__":
    {"listen": listen, "turn": turn}[sys.argv[1]]()
