"""Coverage-guided fuzzing of everything that reads what people hand in, with atheris (libFuzzer for Python).

    python tests/endurance/torture_fuzz.py [--runs 5000] [--seed 1] [--targets recipe,dbc,…] [--json]
    python tests/endurance/torture_fuzz.py --seconds 60 --corpus build/fuzz-corpus
    python tests/endurance/torture_fuzz.py --planted

--seconds: of all targets together, in place of --runs. --corpus: inputs that went new ways are kept there, a folder a
target, and the next time goes on from them. --planted: every reader gets a defect that only an altered input reaches,
and each must be found. Each target of torture_input.py has a process of its own, a copy of this one: `runs` inputs,
grown from a good one by what makes the station's modules (and, with them, PyYAML, cantools and canopen's EDS reader) go
new ways. Faulty is what torture_input calls so; libFuzzer itself ends a process over 1 GiB or an input over 5 s.
"""

import argparse
import ctypes
import json
import os
import re
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

sys.path.insert(0, str(Path(__file__).parents[2]))

if TYPE_CHECKING:
    from tests.endurance.fuzz_targets import Target

MOST_MIB, MOST_S = 1024, 5
#: No longer than so many times the good input, or 4 kB.
_LONGER, _AT_LEAST = 2, 4096
#: A planted defect waits behind so many bytes of the good input.
_SAME = 6
_INSTRUMENTED = ("station", "yaml", "cantools.database.can", "canopen.objectdictionary", "can.io")


@dataclass(frozen=True, slots=True)
class FuzzLimits:
    """Inputs and seconds, whichever is reached first (0 s: no limit), and the seed."""

    runs: int
    seconds: int
    seed: int


def prepare(folder: Path) -> "Mapping[str, Target]":
    """The targets, with everything that they read by instrumented."""
    import atheris

    with atheris.instrument_imports(include=list(_INSTRUMENTED)):
        from tests.endurance import torture_input
    return torture_input.targets(folder)


def child(target: "Target", limits: FuzzLimits, folder: Path, corpus: Path) -> None:
    """Fuzzes one target in this process; libFuzzer ends it."""
    import atheris

    from tests.endurance import torture_input

    corpus.mkdir(parents=True, exist_ok=True)
    (corpus / "good").write_bytes(target.good)

    def one(data: bytes) -> None:
        shown = torture_input.attempt(target, data, folder)
        if shown not in ("taken", "refused"):
            raise AssertionError(shown)

    options = (
        f"-runs={limits.runs}",
        f"-max_total_time={limits.seconds}",
        f"-seed={limits.seed}",
        f"-max_len={max(_LONGER * len(target.good), _AT_LEAST)}",
        f"-rss_limit_mb={MOST_MIB}",
        f"-timeout={MOST_S}",
    )
    words = folder / "words"
    words.write_text("".join(f'"{_escaped(token)}"\n' for token in torture_input.TOKENS if len(token) < 64))
    atheris.Setup([sys.argv[0], *options, f"-dict={words}", f"-artifact_prefix={folder}/", str(corpus)], one)
    atheris.Fuzz()


def with_defect(target: "Target") -> "Target":
    """The same reader, with a defect that only an altered input reaches which begins as the good one does."""

    def read(path: Path) -> object:
        data = path.read_bytes()
        if data != target.good and data[:_SAME] == target.good[:_SAME] and len(data) > _SAME:
            raise RuntimeError("planted")
        return target.read(path)

    return replace(target, read=read)


def _escaped(token: bytes) -> str:
    """A token as a libFuzzer dictionary wants it."""
    return "".join(f"\\x{byte:02x}" for byte in token)


def fuzz(name: str, target: "Target", limits: FuzzLimits, corpus: Path | None = None) -> dict[str, Any]:
    """One target in a process of its own: how many inputs it had, how much it covers, and what was wrong."""
    from tests.endurance.torture_input import SELDOM

    limits = replace(limits, runs=max(limits.runs // SELDOM.get(name, 1), 1))  # its reader is out of coverage's sight
    begun_s = time.monotonic()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        status, printed = _in_a_copy(
            lambda: child(target, limits, folder, (corpus or folder / "corpus") / name), folder
        )
        broken = [p.read_bytes() for p in folder.glob("*-*") if p.name.startswith(("crash", "timeout", "oom"))]
    numbers = [int(n) for n in re.findall(r"^#(\d+)\s", printed, re.MULTILINE)]
    covered = [int(n) for n in re.findall(r"cov: (\d+)", printed)]
    wrong = re.findall(r"AssertionError: (.*)", printed)[:1] or printed.splitlines()[-3:]
    return {
        "target": name,
        "inputs": max(numbers, default=0),
        "first_covered": covered[0] if covered else 0,
        "covered": covered[-1] if covered else 0,
        "faulty": [] if status == 0 else [f"{name}: {wrong} input {(broken or [b''])[0][:200]!r}"],
        "lasted_s": round(time.monotonic() - begun_s, 1),
    }


def _in_a_copy(work: Callable[[], None], folder: Path) -> tuple[int, str]:
    """Exit status of work in a copy of this process, and what it printed."""
    sys.stdout.flush()
    sys.stderr.flush()
    pid = os.fork()
    if pid == 0:
        with (folder / "printed").open("wb") as printed:
            os.dup2(printed.fileno(), 1)
            os.dup2(printed.fileno(), 2)
        try:
            work()
        except BaseException:  # noqa: BLE001 - libFuzzer lets a finding through as what it raised
            traceback.print_exc()
        sys.stdout.flush()
        sys.stderr.flush()
        ctypes.CDLL(None).exit(70)  # C's, at which libFuzzer writes the input; Python's would clean up the original's
    _, status = os.waitpid(pid, 0)
    return status, (folder / "printed").read_text(errors="replace")


def planted(targets: "Mapping[str, Target]", names: Sequence[str], seed: int) -> int:
    """Whether a defect is found in every reader; 1 where one was not."""
    limits = FuzzLimits(2000, 0, seed)
    missed = [name for name in names if "planted" not in str(fuzz(name, with_defect(targets[name]), limits)["faulty"])]
    print(f"planted defects found: {len(names) - len(missed)} of {len(names)}   goal: all   missed: {missed}")
    return int(bool(missed))


def main() -> int:
    """Prints the counts; 1 when an input was faulty."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=int, default=0)
    parser.add_argument("--corpus", type=Path)
    parser.add_argument("--targets", default="")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--planted", action="store_true")
    given = parser.parse_args()
    if find_spec("atheris") is None:
        sys.exit("atheris is not installed here: python -m pip install --group fuzz")
    with tempfile.TemporaryDirectory() as folder:
        targets = prepare(Path(folder))
        names = given.targets.split(",") if given.targets else list(targets)
        if given.planted:
            return planted(targets, names, given.seed)
        seconds = max(given.seconds // len(names), 1) if given.seconds else 0
        limits = FuzzLimits(1 << 30 if seconds else given.runs, seconds, given.seed)
        found = [fuzz(name, targets[name], limits, given.corpus) for name in names]
    faulty = [line for each in found for line in each["faulty"]]
    inputs = sum(each["inputs"] for each in found)
    if given.json:
        print(json.dumps({"inputs": inputs, "faulty": len(faulty), "seed": given.seed, "said": faulty, "of": found}))
        return int(bool(faulty))
    what = "coverage-guided hostile inputs with a traceback, over 5 s or over 1 GiB"
    print(f"{what}: {len(faulty)} of {inputs}   goal: 0   seed {given.seed}")
    for each in found:
        print(f"  {each['target']}: {each['inputs']} inputs, {each['first_covered']} → {each['covered']} branches, "
              f"{each['lasted_s']:.0f} s")  # fmt: skip
    for line in faulty:
        print(f"  {line}")
    return int(bool(faulty))


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(main())
