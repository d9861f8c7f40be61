"""`make validation`: every section of the report can be made. What a thousand units say: docs/benchmarks.md."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
#: Those that take as long whatever the number of units.
LONG = {"bound", "taught", "learnt"}


def test_every_section_of_the_validation_report_is_made() -> None:
    script = ROOT / "benchmarks" / "metrology.py"
    names = subprocess.run([sys.executable, script, "--help"], capture_output=True, text=True, cwd=ROOT, check=True)
    sections = set(names.stdout.split("--only {")[1].split("}")[0].replace("\n", "").replace(" ", "").split(","))
    chosen = sorted(sections - LONG)
    assert len(chosen) >= 13
    command = [sys.executable, str(script), "--units", "12", *(word for name in chosen for word in ("--only", name))]
    made = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert made.returncode == 0, made.stderr
    assert all(f"\n{name}: " in made.stdout for name in chosen)
    assert "CONCLUSION: " in made.stdout
    assert "Not run, so not validated by this report: bound, taught, learnt\n" in made.stdout
