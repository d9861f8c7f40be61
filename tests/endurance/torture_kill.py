"""Kills a run with SIGKILL at every commit point, every SDO exchange and every save, and at random instants; then
asks the log, the device's flash and the next start whether they agree.

    python tests/endurance/torture_kill.py [--points N | --step N --first K] [--instants N] [--seed S] [--recipe FILE]
        [--json]

A point lies before and after each call of the store, each SDO frame that is sent, each SDO transfer and NMT command,
and each save of the device's flash. --points: so many of all points, spread evenly (0: every one); --step, --first:
each N-th, from the K-th on, to try all of them in N parts. Each trial is a process of its own, forked from one that
has loaded everything, and counts only if SIGKILL ended it. The points from the save on are tried twice: the second
time the device loses power half-way through its save, so that there are mixtures to be recognised; so does every
second one of the instants. What a trial must never show:

* lost: a record whose store call had returned, or a PASS that had been shown, is not in the log;
* contradicting: the log says PASS, or says what the device holds, and the flash says otherwise;
* unrecognised: the flash holds a mixture, and the next station to see the unit does not refuse it as one.
"""

import argparse
import json
import os
import shutil
import signal
import struct
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from station.adapters.canopen.canopen_device import CanopenDevice
from station.adapters.canopen.network import ServiceNetwork
from station.adapters.object_access.device import ObjectDevice
from station.adapters.simulated_device.nonvolatile import NonVolatileMemory
from station.adapters.store.reader import SqliteLogReader
from station.adapters.store.sqlite import SqliteStore
from station.domain.core.types import Outcome
from station.domain.product.writeback import classify
from station.domain.records.stored_attempt import result
from station.domain.run.progress import Phase, PhaseEntered, UnitDone
from station.messages import Message
from station.ports.log_reader import Query, Trust
from station.service.runner import Runner
from station.service.stop_request import StopRequest
from station.wiring.bench import open_bench
from station.wiring.run_order import RunOrder

SERIAL = "SN0001"
#: Of every run; another product is another way to the device (docs/device-map.md, `protocol`).
RECIPE: list[str | None] = [None]
#: What is a point: before and after each of these calls.
CALLS: Sequence[tuple[type, tuple[str, ...]]] = (
    (SqliteStore, ("begin", "event", "visit", "write", "result", "finish", "tidy")),
    (CanopenDevice, ("upload", "download", "nmt", "wait_boot_up")),
    (ObjectDevice, ("upload", "download", "nmt", "wait_boot_up")),
    (ServiceNetwork, ("send",)),
    (NonVolatileMemory, ("store",)),
)
#: Store call → where `life` tells what it kept.
_STORED = {"visit": "visits", "write": "writes", "result": "results"}
#: Random instants that fell after the run's end are drawn again, so many times at most.
_DRAWS = 4


@dataclass(frozen=True, slots=True)
class Trial:
    """One death: at the n-th point, or after so many seconds (point 0). torn: the device's save is torn as well.

    seed: of the run; points are tried with one and the same, so that every run passes the same points.
    """

    seed: int
    torn: bool
    point: int = 0
    after_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Whole:
    """A run that nobody kills: how many points it has, the one at which the flash is first written, and its time."""

    points: int
    saving: int
    lasts_s: float


@dataclass(frozen=True, slots=True)
class Chosen:
    """Which of all points: so many, spread evenly (0: all), or each `step`-th from `first` on."""

    count: int = 0
    step: int = 1
    first: int = 0

    def of(self, points: int) -> Sequence[int]:
        """Their numbers, from 0 on."""
        if self.count:
            return [int(i) for i in np.unique(np.linspace(0, points - 1, self.count).astype(int))]
        return range(self.first, points, self.step)


class Death:
    """Counts points and kills this process at the wanted one; tells the parent what had returned by then."""

    def __init__(self, pipe: int, point: int) -> None:
        self.points, self._pipe, self._point = 0, pipe, point

    def pass_by(self) -> None:
        """One more point."""
        self.points += 1
        if self.points == self._point:
            os.kill(os.getpid(), signal.SIGKILL)

    def tell(self, what: str) -> None:
        """Whoever watches has seen this."""
        os.write(self._pipe, f"{what}\n".encode())

    def around(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """The call with a point before and one after it."""

        def deadly(*args: Any, **kwargs: Any) -> Any:
            self.pass_by()
            if name == "store":
                self.tell(f"saving {self.points}")
            returned = call(*args, **kwargs)
            if name == "begin" or name in _STORED:
                for _ in args[2:] if name == "write" else args[:1]:  # every stage of a write is a record of its own
                    self.tell(name)
            self.pass_by()
            return returned

        return deadly


@contextmanager
def forked(work: Callable[[int], None]) -> Iterator[tuple[int, int]]:
    """`work(pipe)` in a process of its own: its id, and the end of the pipe that reads."""
    reads, writes = os.pipe()
    child = os.fork()
    if child == 0:
        code = 70
        try:
            os.close(reads)
            work(writes)
            code = 0
        finally:
            os._exit(code)
    os.close(writes)
    try:
        yield child, reads
    finally:
        os.close(reads)


def run(folder: Path, seed: int, *, torn: bool = False, until: Phase | None = None, death: Death | None = None) -> None:
    """A whole simulated run, or one that the operator stops on entering the phase `until`."""
    faults = ("save-torn",) if torn else ()
    order = RunOrder(
        simulate=True, database=folder / "station.db", device_state=folder / "devices", seed=seed, recipe=RECIPE[0]
    )
    stop = StopRequest()
    with open_bench(replace(order, faults=faults)) as bench:
        (seats,) = bench.loads([SERIAL])
        bench.fixture.place(seats)
        for event in Runner(bench.station, bench.job, stop).run(seats):
            if isinstance(event, PhaseEntered) and event.phase is until:
                stop.request(Message.text("seen enough"))
            if isinstance(event, UnitDone) and death is not None:
                death.tell(f"shown {event.result.outcome}")


def doomed(folder: Path, trial: Trial, pipe: int) -> None:
    """The run that dies; one that comes to its end tells how many points it passed."""
    death = Death(pipe, trial.point)
    for kind, names in CALLS:
        for name in names:
            setattr(kind, name, death.around(name, getattr(kind, name)))
    run(folder, trial.seed, torn=trial.torn, death=death)
    death.tell(f"points {death.points}")


def die(folder: Path, trial: Trial) -> tuple[list[str], bool]:
    """Runs the trial; what had been seen before its end, and whether that was its death."""
    with forked(lambda pipe: doomed(folder, trial, pipe)) as (child, pipe):
        if trial.after_s:
            time.sleep(trial.after_s)
            os.kill(child, signal.SIGKILL)
        report = b"".join(iter(lambda: os.read(pipe, 65536), b""))
        _, status = os.waitpid(child, 0)
    if os.WIFEXITED(status) and os.WEXITSTATUS(status):
        raise RuntimeError(f"{trial} broke off by itself with status {os.WEXITSTATUS(status)}")
    return report.decode().splitlines(), os.WIFSIGNALED(status)


def come_again(folder: Path, number: int) -> None:
    """The next start takes the same unit, and stops before anything is measured."""
    with forked(lambda _: run(folder, number, until=Phase.MEASURE)) as (child, _):
        _, status = os.waitpid(child, 0)
    if status:
        raise RuntimeError(f"the next start in {folder} ended with status {status}")


def lives(folder: Path) -> list[dict[str, Any]]:
    """Every attempt of the unit, oldest first; the chain of the log is checked on the way."""
    with SqliteLogReader(folder / "station.db") as log:
        found = list(log.findings(Trust()))
        if found:
            raise RuntimeError(f"the log in {folder} is broken: {found[0]}")
        return log.life(Query(serial=SERIAL))


def flash(folder: Path, like: dict[str, str]) -> dict[str, str]:
    """What the device would read as after power-on, as hex, for the objects in `like`; read from its own file."""
    held = json.loads((folder / "devices" / f"{SERIAL}.json").read_text())["objects"]
    return {at: raw(held[at], len(like[at]) // 2) for at in like}


def flash_state(folder: Path, base: Path, planned: Any) -> str:
    """Whether the flash holds the old values, the new ones, or some of each."""
    old: Any = flash(base, planned)  # values and addresses as the log writes them; they are only compared
    now: Any = flash(folder, planned)
    return classify(old, planned, now)


def raw(value: float | int | str, size: int) -> str:
    """A value of the flash file as hex."""
    if isinstance(value, str):
        return value.encode().hex()
    return (struct.pack("<f", value) if isinstance(value, float) else value.to_bytes(size, "little")).hex()


def judge(folder: Path, trial: Trial, base: Path) -> tuple[list[str], str] | None:
    """Everything that is wrong after this trial, as `kind: what`, and what the flash holds; None: it did not die."""
    observed, died = die(folder, trial)
    if not died:
        return None
    before = lives(folder)
    attempt = before[1] if len(before) > 1 else None
    wrong = [f"lost: {what}" for what in lost(observed, attempt)]
    if attempt is None:
        return wrong, "old"
    planned = (result(attempt, "write-plan") or {}).get("objects", {})
    truth = flash_state(folder, base, planned) if planned else "old"
    wrong += [f"contradicting: {what}" for what in contradicting(attempt, truth)]
    come_again(folder, trial.seed + 1)
    wrong += [f"unrecognised: {what}" for what in unrecognised(lives(folder), truth)]
    return wrong, truth


def lost(observed: Sequence[str], attempt: dict[str, Any] | None) -> Iterator[str]:
    """What had returned before the death and is not in the log."""
    counts = Counter(observed)
    if counts["begin"] and attempt is None:
        yield "the attempt"
    elif attempt is not None:
        for call, stored in _STORED.items():
            if counts[call] > len(attempt[stored]):
                yield f"{counts[call] - len(attempt[stored])} of the {counts[call]} {stored}"
        shown = [line.removeprefix("shown ") for line in observed if line.startswith("shown ")]
        if shown and attempt["outcome"] != shown[0]:
            yield f"{shown[0]} was shown, the log says {attempt['outcome']}"


def contradicting(attempt: dict[str, Any], truth: str) -> Iterator[str]:
    """Where the log's word is not the device's."""
    if attempt["outcome"] == Outcome.PASS and truth != "new":
        yield f"PASS, but the flash holds {truth} values"
    state = (result(attempt, "device-state") or {}).get("state")
    if state in ("old", "new", "mixed") and state != truth:
        yield f"device-state {state}, but the flash holds {truth} values"
    if not attempt["writes"] and truth != "old":
        yield f"no write is recorded, but the flash holds {truth} values"


def unrecognised(found: Sequence[dict[str, Any]], truth: str) -> Iterator[str]:
    """What the next start did not see."""
    interrupted, again = found[1], found[2]
    if interrupted["outcome"] is None:
        yield "the attempt is still open"
    report = [e["detail"]["state"] for e in interrupted["events"] if e["kind"] == "device-state"]
    if report and report[-1] != truth:
        yield f"the next start took {truth} values for {report[-1]}"
    if truth == "mixed" and (again["outcome"] != Outcome.FAIL or not report):
        yield f"a mixture was taken on with outcome {again['outcome']}"


def at_points(chosen: Chosen, seed: int, whole: Whole, torn: Whole) -> Iterator[Trial]:
    """Every point, then those that a torn save changes: from the save to that run's end; of them those chosen."""
    every = [*((False, p) for p in range(1, whole.points + 1)), *((True, p) for p in range(torn.saving, torn.points))]
    for save_torn, point in (every[i] for i in chosen.of(len(every))):
        yield Trial(seed, save_torn, point=point)


def at_instants(instants: int, lasts_s: float, seed: int) -> Iterator[Trial]:
    """Random instants without end: whoever takes them stops when enough have killed."""
    rng = np.random.default_rng(seed)
    for number in range(_DRAWS * instants):
        yield Trial(seed + number, number % 2 == 1, after_s=float(rng.uniform(0.0, lasts_s)))


class Count:
    """What the trials came to."""

    def __init__(self, folder: Path, base: Path) -> None:
        self._folder, self._base = folder, base
        self.deaths: Counter[str] = Counter()
        self.survived: list[str] = []
        self.wrong: Counter[str] = Counter()
        self.held: Counter[str] = Counter()
        self.printed: list[str] = []

    def add(self, trial: Trial) -> None:
        """Tries it in a folder of its own."""
        folder = Path(shutil.copytree(self._base, self._folder / "trial"))
        judged = judge(folder, trial, self._base)
        shutil.rmtree(folder)
        if judged is None:
            self.survived.append(str(trial))
            return
        found, truth = judged
        self.wrong.update(line.split(":")[0] for line in found)
        self.printed += [f"{trial}: {line}" for line in found]
        self.held[truth] += 1
        self.deaths["points" if trial.point else "instants"] += 1


def torture(chosen: Chosen, instants: int, seed: int) -> dict[str, Any]:
    """The counts."""
    begun_s = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        base = Path(name) / "base"
        base.mkdir()
        run(base, seed)  # here, so that every fork has everything loaded
        seed += 1
        whole, torn = (measured(Path(name), base, Trial(seed, torn)) for torn in (False, True))
        count = Count(Path(name), base)
        planned = list(at_points(chosen, seed, whole, torn))
        for trial in planned:
            count.add(trial)
        not_reached = len(count.survived)
        for trial in at_instants(instants, whole.lasts_s, seed):
            if count.deaths["instants"] == instants:
                break
            count.add(trial)
    return {
        "deaths": dict(count.deaths),
        "points": whole.points,
        "torn_points": torn.points - torn.saving,
        "planned": len(planned),
        "not_reached": not_reached,
        "lost": count.wrong["lost"],
        "contradicting": count.wrong["contradicting"],
        "unrecognised": count.wrong["unrecognised"],
        "flash_held": dict(count.held),
        "seed": seed - 1,
        "lasted_s": round(time.monotonic() - begun_s, 1),
        "said": count.printed,
    }


def measured(folder: Path, base: Path, trial: Trial) -> Whole:
    """How many points the run has, and how long it takes."""
    copy = Path(shutil.copytree(base, folder / "whole"))
    begun_s = time.monotonic()
    report, _ = die(copy, trial)
    lasts_s = time.monotonic() - begun_s
    shutil.rmtree(copy)
    printed = dict(line.rsplit(" ", 1) for line in reversed(report) if line.startswith(("points ", "saving ")))
    return Whole(int(printed["points"]), int(printed["saving"]), lasts_s)


def main() -> int:
    """Prints the counts; 1 when one of them is not as it must be."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=0)
    parser.add_argument("--step", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--instants", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--recipe", help="in place of six-point; another product is another protocol")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    RECIPE[0] = given.recipe
    report = torture(Chosen(given.points, given.step, given.first), given.instants, given.seed)
    good = not (report["lost"] or report["contradicting"] or report["unrecognised"] or report["not_reached"])
    if given.json:
        print(json.dumps(report))
        return int(not good)
    deaths = report["deaths"]
    wrong = f"{report['lost']} / {report['contradicting']} / {report['unrecognised']}"
    print(
        f"SIGKILL at {deaths.get('points', 0)} of {report['points']} points + {report['torn_points']} of a torn save, "
        f"at {deaths.get('instants', 0)} random instants: records lost / logs contradicting the device / half-written "
        f"devices not recognised = {wrong}   goal: 0 / 0 / 0   seed {report['seed']}"
    )
    print(f"  {report['lasted_s']:.0f} s; the flash held {report['flash_held']} values")
    print(f"  points not reached: {report['not_reached']} of {report['planned']}   goal: 0")
    for line in report["said"][:20]:
        print(f"  {line}")
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
