"""Runs a benchmark where a kernel vcan exists: in a network namespace, or in the guest that the vcan tests boot.

python benchmarks/on_vcan.py receive.py --rows 1 --runs 5
"""

import shlex
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "tests" / "vcan"))

from vcan_harness import cache, ways
from vcan_harness.job import Job


def main() -> None:
    """Starts the benchmark named first, with the arguments after it, and prints what it says."""
    script, *arguments = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        way = ways.find(work, (HERE.parent, Path(sys.prefix), Path(sys.base_prefix), cache.folder()))
        printed = work / "said.txt"
        command = shlex.join([sys.executable, str(HERE / script), *arguments])
        job = Job(way, work, HERE.parent, ["sh", "-c", f"{command} > {shlex.quote(str(printed))} 2>&1"], {})
        for _ in job.reports():  # a benchmark reports nothing; this waits for its end
            continue
        print(printed.read_text() if printed.is_file() else job.last_words())


if __name__ == "__main__":
    main()
