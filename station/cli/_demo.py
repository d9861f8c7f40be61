"""The tour of `station demo`: commands as a person would type them, shown with what they print."""

import os
import shlex
import sys
from collections.abc import Iterator
from contextlib import chdir, contextmanager, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

from station.cli import _output
from station.errors import StationFault
from station.messages import Message, render


@dataclass(frozen=True, slots=True)
class TourStep:
    """A command line of the tour; code: how it ends where all is as it should be; shows: id of what to look at."""

    line: str
    code: int = 0
    shows: str = ""


#: Before the first load: the golden unit, by its certificate, and its check; a run of another that may become one.
PREPARATION = (
    TourStep('golden register SN9001 --value "gain z=1.0053:0.002" --due 2035-06-30'),
    TourStep("run --serial SN9001"),
    TourStep("run --serial SN9003"),
)
TOUR = (
    TourStep("run --serial SN0001 --serial SN0002 --serial SN0042 --serial SN0043", 0, "demo-good-load"),
    TourStep("run --serial SN0003 --serial SN9002 --serial SN0044 --fault SN0044/save-torn", 3, "demo-bad-load"),
    TourStep("run --recipe n-point --units 4 --effect cross-axis=0.003", 0, "demo-hidden-effect"),
    TourStep("diagnose --db station.db --recipe n-point --report report.html", 1, "demo-diagnosis"),
    TourStep("audit", 0, "demo-audit"),
    TourStep("audit --verify", 0, "demo-verify"),
)
#: What the examples of the helps read and no earlier one of them has made.
FILES = (
    TourStep("golden register SN9002 --bad"),
    TourStep("export --serial SN0042 --frames SN0042.log"),
    TourStep("export --serial SN0043 --frames drive.blf"),
    TourStep("certificate SN0042 --pdf SN0042.pdf"),
    TourStep("simulate --recipe six-point --units 2 --out samples.csv"),
    TourStep("simulate --recipe norm --units 2 --out norm.csv"),
    TourStep("simulate --recipe tilt-24 --units 4 --effect nest-tilt --effect quadratic=0.001 --out samples.parquet"),
    TourStep("diagnose --samples samples.parquet --recipe tilt-24 --extend model.yaml", 1),
    TourStep("import turned.csv --out turned.parquet"),
    TourStep("segment turned.csv --out stops.csv"),
)


def take_tour(folder: Path) -> int:
    """Makes the folder, shows the tour in it; 0 when every step ended as it should. Errors: UsageError."""
    from station.wiring.demo_folder import create_empty_logs, create_folder

    create_folder(folder)
    with chdir(folder):
        create_empty_logs()
        _output.print_line(render(Message("demo-begins", folder=str(folder), steps=len(TOUR))))
        with _silence():
            _take_all(PREPARATION)
        for number, step in enumerate(TOUR, 1):
            _output.print_line(f"\n{number}. {render(Message(step.shows))}")
            _output.print_command(f"$ station {step.line}")
            _take(step)
        with _silence():
            _take_all(FILES)
    _output.print_line("\n" + render(Message("demo-ends", folder=str(folder))))
    return 0


def _take_all(steps: tuple[TourStep, ...]) -> None:
    for step in steps:
        _take(step)


def _take(step: TourStep) -> None:
    from station.cli.app import run_command

    code = run_command(shlex.split(step.line))
    sys.stdout.flush()
    if code != step.code:
        raise StationFault("demo-step-failed", line=step.line, code=code, expected=step.code)


@contextmanager
def _silence() -> Iterator[None]:
    """Neither results nor remarks."""
    variable = _output.FLAGS["--quiet"]
    before = os.environ.get(variable)
    os.environ[variable] = "1"
    try:
        with Path(os.devnull).open("w", encoding="utf-8") as nowhere, redirect_stdout(nowhere):
            yield
    finally:
        if before is None:
            del os.environ[variable]
        else:
            os.environ[variable] = before
