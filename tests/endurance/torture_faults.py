"""Runs the fault table (tests/faults/table.py, shown in docs/faults.md) and counts the rows that come out as they must.

python tests/endurance/torture_faults.py [--every 1] [--json]
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from tests.faults.table import ROWS

TESTS = "tests/integration/test_faults.py"
#: `make test` tries some of the rows.
WHOLE = {**os.environ, "STATION_TESTS": "all"}


def main() -> int:
    """Prints the count; 1 when a row came out otherwise."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    chosen = ROWS[:: given.every]
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        names = {row.inject for row in chosen}
        some = [] if given.every == 1 else _ids(names)
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", f"--junitxml={report}"]
        subprocess.run([*command, *(some or [TESTS])], cwd=ROOT, env=WHOLE, capture_output=True, check=False)
        cases = [c for c in ET.parse(report).iter("testcase") if "[" in (c.get("name") or "")]
    wrong = [str(c.get("name")) for c in cases if c.find("failure") is not None or c.find("error") is not None]
    right = len(cases) - len(wrong)
    if given.json:
        print(json.dumps({"rows": len(chosen), "right": right, "said": wrong}))
    else:
        print(f"fault table: {right} of {len(chosen)} rows come out as they must   goal: all of ≥ 60")
        for name in wrong:
            print(f"  {name}")
    return int(right != len(chosen))


def _ids(names: set[str]) -> list[str]:
    """pytest's names of these rows: it writes some characters otherwise, so they are asked for."""
    listed = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "--collect-only", TESTS], cwd=ROOT, env=WHOLE, capture_output=True,
        text=True, check=True,
    )  # fmt: skip
    return [line for line in listed.stdout.splitlines() if "[" in line and line.partition("[")[2].rstrip("]") in names]


if __name__ == "__main__":
    sys.exit(main())
