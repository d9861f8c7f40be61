"""Everything that is promised about the worst days, tried in earnest: `make torture`.

    python tests/endurance/torture.py [--seed 1] [--scale 1] [--only kill,edits,…] [--json FILE]

An hour and more; --scale 0.01 tries a hundredth of everything, in minutes. Prints a table of what was tried, how often,
what came of it, the goal and the seed; --json keeps what each part came to, so that a run that was stopped goes on with
--only. 1 when a goal was missed.
"""

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
Report = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Part:
    """One script: its options for a scale, and the rows (what, count, result, goal) that its JSON comes to."""

    name: str
    file: str
    options: Callable[[float], Sequence[object]]
    rows: Callable[[Report], Sequence[tuple[str, str, str, str]]]


def most(count: int, scale: float, least: int) -> int:
    """So many at that scale."""
    return max(round(count * scale), least)


def kills(shown: Report) -> Sequence[tuple[str, str, str, str]]:
    """SIGKILL."""
    deaths = shown["deaths"]
    wrong = f"{shown['lost']} / {shown['contradicting']} / {shown['unrecognised']}"
    printed = f"{deaths.get('points', 0)} points + {deaths.get('instants', 0)} instants"
    what = "SIGKILL: records lost / logs contradicting the device / half-written devices not recognised"
    reached = f"{shown['planned'] - shown['not_reached']} of {shown['planned']}"
    return (what, printed, wrong, "0 / 0 / 0"), (
        "… chosen points at which the run really died",
        printed,
        reached,
        "all",
    )


def faults(shown: Report) -> Sequence[tuple[str, str, str, str]]:
    """The fault table."""
    return (
        ("fault table: right outcome and sentence", f"{shown['rows']} rows", f"{shown['right']} right", "all, ≥ 60"),
    )


def stops(shown: Report) -> Sequence[tuple[str, str, str, str]]:
    """A nervous finger."""
    what = "Stop pressed 1 to 20 times: parked, put back, finished"
    return ((what, f"{shown['instants']} instants", str(shown["right"]), "all"),)


def intruders(shown: Report) -> Sequence[tuple[str, str, str, str]]:
    """Somebody else at the bench."""
    what = "foreign writes, resets, swaps: found before PASS"
    return ((what, f"{shown['instants']} instants", str(shown["found"]), "all"),)


def attacks(shown: Report) -> Sequence[tuple[str, str, str, str]]:
    """Somebody with the log's files, with and without its key."""
    what = "intelligent edits of the log, with and without its key: found by --verify / refused by the next run"
    return ((what, str(shown["trials"]), f"{shown['found']} / {shown['refused']}", "all / all"),)


def hostile(shown: Report) -> Sequence[tuple[str, str, str, str]]:
    """Files made to exhaust their reader."""
    what = "hostile files of at most 10 MB: over 1 GiB, over 10 s, exit code 70, or killed"
    worst = f"{shown['faulty']}; worst {shown['most_mib']} MiB, {shown['longest_s']:.1f} s"
    return ((what, f"{shown['files']} commands", worst, "0"),)


def edits(shown: Report) -> Sequence[tuple[str, str, str, str]]:
    """Edits of the log."""
    found = shown["edits"] - shown["missed"]
    return (("random edits of the log found by --verify", str(shown["edits"]), f"{found} found", "all"),)


def inputs(shown: Report) -> Sequence[tuple[str, str, str, str]]:
    """Mutated inputs."""
    return (("hostile inputs: traceback, hang over 5 s, over 1 GiB", str(shown["inputs"]), str(shown["faulty"]), "0"),)


def fuzzed(shown: Report) -> Sequence[tuple[str, str, str, str]]:
    """Coverage-guided inputs."""
    return (("the same, guided by coverage (atheris)", str(shown["inputs"]), str(shown["faulty"]), "0"),)


def power(shown: Report) -> Sequence[tuple[str, str, str, str]]:
    """Power cuts."""
    tried = sum(shown["tried"].values())
    what = "power cut at an fsync: logs that lost a record, broke or did not open"
    return ((what, f"{shown['fsyncs']} fsyncs, {tried} logs", str(shown["faulty"]), "0"),)


def lasting(shown: Report) -> Sequence[tuple[str, str, str, str]]:
    """Many units."""
    grown = f"{100 * shown['memory_growth']:+.1f} % / {shown['threads_growth']:+d} / {shown['files_growth']:+d}"
    count = f"{shown['units']} units, {shown['passed']} passed"
    return (
        (f"memory after the first {shown['after']} / threads / descriptors", count, grown, "< 5 % / 0 / 0"),
        ("… write-ahead log at most", count, f"{shown['wal_mib']:.1f} MiB", "< 64 MiB"),
    )


def full_bus(shown: Report) -> Sequence[tuple[str, str, str, str]]:
    """A full bus."""
    count = f"{shown['frames']} frames, {shown['kept']} visits kept, {shown['rejected']} rejected"
    return (("frames lost at a full 1 Mbit/s in visits that were kept", count, str(shown["lost_in_kept"]), "0"),)


def page(shown: Report) -> Sequence[tuple[str, str, str, str]]:
    """The page under attack."""
    what = (
        f"{shown['idle']} idle and {shown['slow']} slow clients, {shown['guesses']} guesses: Stop unanswered / p99, s"
    )
    refused = f"{shown['refused']} of {shown['log_ins']}"
    return (
        (what, str(shown["stops"]), f"{shown['stops_unanswered']} / {shown['stop_p99_s']:.2f}", "0 / 0.5"),
        ("right passwords refused meanwhile; opened by a guess", "", f"{refused}; {shown['opened_by_guess']}", "0; 0"),
    )


PARTS = (
    Part("kill", "torture_kill.py",
         lambda s: ("--points", 0 if s >= 1 else most(587, s, 8), "--instants", most(1000, s, 4)), kills),
    Part("faults", "torture_faults.py", lambda s: ("--every", max(round(1 / s) // 10, 1)), faults),
    Part("stops", "torture_stops.py", lambda s: ("--instants", most(500, s, 10)), stops),
    Part("intruder", "torture_intruder.py", lambda s: ("--instants", most(1000, s, 10)), intruders),
    Part("edits", "torture_edits.py", lambda s: ("--edits", most(10_000, s, 100)), edits),
    Part("log", "log_attacks.py", lambda s: ("--trials", most(2000, s, 54)), attacks),
    Part("hostile", "hostile_files.py", lambda s: () if s >= 0.1 else ("--only", "marks"), hostile),
    Part("power", "torture_power.py", lambda s: ("--every", 1 if s >= 1 else 5), power),
    Part("inputs", "torture_input.py", lambda s: ("--inputs", most(100_000, s, 300)), inputs),
    Part("fuzz", "torture_fuzz.py",
         lambda s: ("--runs", most(5000, s, 300), "--targets", "" if s >= 0.1 else "recipe,dbc,candump"), fuzzed),
    Part("full-bus", "full_bus.py", lambda s: ("--seconds", most(60, s, 5)), full_bus),
    Part("page", "torture_page.py",
         lambda s: ("--idle", most(1000, s, 50), "--slow", most(1000, s, 50), "--guesses", most(10_000, s, 20)), page),
    Part("lasting", "torture_lasting.py",
         lambda s: ("--units", most(10_000, s, 20), "--after", most(500, s, 10)), lasting),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Done:
    """A part that has been run. shown: its own JSON, None when it broke off."""

    code: int
    shown: Report | None
    took_s: float
    seed: int
    scale: float

    def rows(self, part: Part) -> list[tuple[str, ...]]:
        """Its lines of the table."""
        found = [(part.name, "", "broke off", "")] if self.shown is None else part.rows(self.shown)
        end = (str(self.seed), f"{self.took_s:.0f} s", "met" if self.code == 0 else "MISSED")
        return [(*row, *end) for row in found]


def run(part: Part, scale: float, seed: int) -> Done:
    """Runs it in a process of its own."""
    begun_s = time.monotonic()
    seeded = () if part.name in ("full-bus", "faults", "hostile") else ("--seed", seed)
    command = [sys.executable, str(HERE / part.file), "--json", *map(str, (*part.options(scale), *seeded))]
    print(f"{part.name}: {' '.join(command[1:])}", file=sys.stderr, flush=True)
    done = subprocess.run(command, cwd=HERE.parent, stdout=subprocess.PIPE, text=True, check=False)
    try:
        shown = json.loads(done.stdout)
    except ValueError:
        shown = None
    for line in (shown or {}).get("said", [])[:20]:
        print(f"  {line}", file=sys.stderr)
    return Done(done.returncode, shown, round(time.monotonic() - begun_s, 1), seed, scale)


def table(done: Mapping[str, Done]) -> str:
    """What has been run so far, columns under each other."""
    rows: list[tuple[str, ...]] = [("what", "tried", "came to", "goal", "seed", "took", "")]
    for part in (p for p in PARTS if p.name in done):
        rows += done[part.name].rows(part)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows)


def main() -> int:
    """Runs every part, or those asked for; Ctrl-C ends the present one, and what is done is shown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--only", default=",".join(part.name for part in PARTS))
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    wanted = given.only.split(",")
    if unknown := set(wanted) - {part.name for part in PARTS}:
        parser.error(f"there is no part {', '.join(sorted(unknown))}; the parts are {', '.join(p.name for p in PARTS)}")
    done: dict[str, Done] = {}
    if given.json and given.json.exists():
        done = {name: Done(**stored) for name, stored in json.loads(given.json.read_text()).items()}
    try:
        for part in (p for p in PARTS if p.name in wanted):
            done[part.name] = run(part, given.scale, given.seed)
            if given.json:
                given.json.write_text(json.dumps({name: asdict(each) for name, each in done.items()}, indent=1))
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
    print(table(done))
    return int(set(wanted) - set(done) != set() or any(each.code for each in done.values()))


if __name__ == "__main__":
    sys.exit(main())
