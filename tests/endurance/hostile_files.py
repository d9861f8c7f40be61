"""Small files that were made to exhaust their reader, handed to the real commands, one process each.

    python tests/endurance/hostile_files.py [--only WORD] [--part 1/5] [--json]

Every kind of file that the station reads, at most 10 MB: tables as text and Parquet, MAT, MF4, BLF, ASC and candump
recordings, marks, recipes, settings, models, DBC, EDS, archives, databases. Faulty is a command that needs more than
1 GiB or 10 s of processor, or that ends by a signal, a traceback or exit code 70.
"""

import argparse
import json
import multiprocessing
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from station.config.search_path import shipped_folder
from tests.fakes import hostile
from tests.fakes.hostile import HostileFile

MOST_S, MOST_BYTES = 10.0, 1 << 30
#: A command that has not ended by then is killed: it is faulty anyway.
PATIENCE_S = 60.0
CODES = range(5)


@dataclass(frozen=True, slots=True)
class Tried:
    """What came of one file. printed: the end of its standard error."""

    name: str
    size_bytes: int
    code: int
    processor_s: float
    took_s: float
    memory_bytes: int
    printed: str

    @property
    def faulty(self) -> str:
        """What is wrong; "" where nothing is."""
        wrong = [f"exit {self.code}"] if self.code not in CODES else []
        wrong += ["a traceback"] if "Traceback" in self.printed else []
        wrong += [f"{self.processor_s:.1f} s"] if self.processor_s > MOST_S else []
        wrong += [f"{self.memory_bytes >> 20} MiB"] if self.memory_bytes > MOST_BYTES else []
        return ", ".join(wrong)

    def line(self) -> str:
        """One line of the table."""
        figures = f"exit {self.code:3d} {self.processor_s:5.1f} s {self.memory_bytes >> 20:5d} MiB"
        return (
            f"{'FAULTY' if self.faulty else 'ok':6s} {self.name:36s} {figures}  {self.faulty or self.printed[:110]!r}"
        )


def shipped() -> dict[str, Path]:
    """The station's own files of which mutants are made."""
    folder = shipped_folder()
    return {
        "dbc": folder / "dbc" / "accelerometer.dbc",
        "eds": folder / "dbc" / "accelerometer.eds",
        "recipe": folder / "recipes" / "six-point.yaml",
        "config": folder / "config.yaml",
    }


def attempts(file: HostileFile) -> Iterator[Tried]:
    """Makes the file in a process of its own, hands it over, and measures each command and all its children."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        maker = multiprocessing.get_context("fork").Process(target=file.make, args=(folder,))
        maker.start()  # what it needs would count as memory of the commands, which begin as copies of this process
        maker.join()
        size = max(p.stat().st_size for p in folder.rglob("*") if p.is_file())
        for command in file.commands:
            yield _attempt(f"{command[0]} {file.name}", folder, command, size)


def _attempt(name: str, folder: Path, command: Sequence[str], size: int) -> Tried:
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(Path(__file__).parents[2])}
    with tempfile.TemporaryFile() as printed:
        begun_s = time.monotonic()
        child = subprocess.Popen(
            [sys.executable, "-m", "station", *command],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=printed,
            env=environment,
            start_new_session=True,
        )
        code, usage = _wait(child, begun_s)
        took_s = time.monotonic() - begun_s
        printed.seek(0)
        text = printed.read()[-2000:].decode("utf-8", "replace")
    return Tried(name, size, code, usage.ru_utime + usage.ru_stime, took_s, usage.ru_maxrss * 1024, text)


def _wait(child: "subprocess.Popen[bytes]", begun_s: float) -> tuple[int, resource.struct_rusage]:
    while True:
        pid, status, usage = os.wait4(child.pid, os.WNOHANG)
        if pid:
            child.returncode = os.waitstatus_to_exitcode(status)
            return child.returncode, usage
        if time.monotonic() > begun_s + PATIENCE_S:
            os.killpg(child.pid, 9)
            _, _, usage = os.wait4(child.pid, 0)
            child.returncode = -9
            return -9, usage
        time.sleep(0.02)


def main() -> int:
    """Prints what was faulty and the worst of the rest; 1 when anything was faulty."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="Files whose name contains this.")
    parser.add_argument("--part", default="1/1", help="K/N: the K-th of N equal shares of them.")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    first, shares = map(int, given.part.split("/"))
    tried = []
    for file in [file for file in hostile.every(shipped()) if given.only in file.name][first - 1 :: shares]:
        for one in attempts(file):
            tried.append(one)
            if not given.json:
                print(one.line(), flush=True)
    faulty = [one for one in tried if one.faulty]
    longest_s, most_mib = max(t.processor_s for t in tried), max(t.memory_bytes for t in tried) >> 20
    if given.json:
        lines = [f"{one.name}: {one.faulty}" for one in faulty]
        figures = {"files": len(tried), "faulty": len(faulty), "longest_s": longest_s, "most_mib": most_mib}
        print(json.dumps({**figures, "said": lines, "tried": list(map(asdict, tried))}))
        return int(bool(faulty))
    print(f"hostile files of at most 10 MB: {len(faulty)} of {len(tried)} faulty, goal 0")
    print(f"longest {longest_s:.1f} s, most {most_mib} MiB")
    return int(bool(faulty))


if __name__ == "__main__":
    sys.exit(main())
