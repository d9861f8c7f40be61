"""Real sensors recorded by others: residuals of the magnitude, and agreement with imucal.

    python benchmarks/real_recordings.py [--data DIR]

DIR (or STATION_REFERENCE_DATA) holds the recordings; see tests/integration/test_real_recordings.py, which asserts
what is printed here. One recording each, so there is no spread over runs; the uncertainty stands beside each figure.
"""

import argparse
import os
from contextlib import redirect_stderr, redirect_stdout
from importlib.metadata import version
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from station.domain.capture import rest_segments
from station.domain.evaluation import model_comparison
from tests.fakes import tumble
from tests.integration import test_real_recordings as recordings


def main() -> None:
    """Prints both."""
    extra = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("STATION_REFERENCE_DATA", extra)))
    folder = parser.parse_args().data
    xsens(folder)
    diagnosis(folder)
    imucal(folder)


def shown(what: str, figure: float, goal: str, met: bool) -> None:
    """One row."""
    print(f"  {what:<58} {figure:>9.4g}   goal {goal:<10} {'met' if met else 'MISSED'}")


def xsens(folder: Path) -> None:
    """An Xsens MTi turned by hand; the rests are found by the code."""
    raw = np.loadtxt(folder / "xsens_mti_tumble" / "xsens_acc.mat")
    reading = (raw[:, 1:] - recordings.XSENS_ZERO) / recordings.XSENS_SCALE / recordings.XSENS_G
    found = rest_segments.find(raw[:, 0], reading)
    names = [f"still-{i:02d}" for i in range(len(found))]
    recipe = recordings.by_hand()
    result = tumble.calibrate_unit(recipe, rest_segments.table(raw[:, 0], reading, found, "MTi", names), tumble.TODAY)
    assert result.calibration is not None and result.visits is not None
    quadratic, cubic = model_comparison.of_unit(recipe, result)
    print("Xsens MTi, 512 s by hand, norm fit, mg")
    shown("still segments found", len(found), "39", len(found) == 39)
    rms = 1e3 * result.calibration.residual_rms
    shown("residual in sample", rms, "<= 0.105", rms <= 0.105)
    shown(
        "residual leaving one orientation out",
        1e3 * quadratic.rms_left_out,
        "<= 0.18",
        quadratic.rms_left_out <= 0.18e-3,
    )
    for one in (quadratic, cubic):
        shown(f"{one.terms} terms: p of the F test", one.p, "rejected", not one.pays)
        before, after = 1e3 * one.rms_left_out, 1e3 * one.larger_rms_left_out
        print(f"    leaving one orientation out they make {before:.3f} into {after:.3f}")
    white = 1e3 * (result.visits.std / np.sqrt(result.visits.count[:, None])).mean()
    own = 1e3 * np.sqrt(np.einsum("vii->vi", result.visits.cov).mean())
    print(f"    standard error of a stop: white noise would give {white:.3f}, this code states {own:.3f}")


def diagnosis(folder: Path) -> None:
    """The same recording through `station segment` and `station diagnose`: what a gain-and-offset simulation misses."""
    with TemporaryDirectory() as scratch, redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        found = recordings.diagnosed(Path(scratch), folder)
        whole = Path(scratch) / "matrix.yaml"
        whole.write_text("schema: station.model/1\ncalibration: matrix\n", encoding="utf-8")
        control = recordings.diagnosed(Path(scratch), folder, "--model", str(whole))
    names = [c["effect"] for c in found["causes"]]
    left, held_out = 1e3 * found["extended"]["residual_rms"], 1e3 * found["causes"][0]["gain"]["rms_after"]
    print(f"Xsens MTi diagnosed, gain and offset alone: {found['verdict']} {', '.join(names)}; mg")
    before, right = 1e3 * found["baseline"]["residual_rms"], names == ["cross-axis"]
    print(f"    residual before {before:.3g}; cross-axis and only it: {'met' if right else 'MISSED'}")
    shown("residual with what was found", left, "0.10", left <= 0.105)
    shown("held out", held_out, "<= 0.18", held_out <= 0.18)
    bends = {c["effect"]: c["log_evidence"] for c in control["considered"]}
    worst = max(bends["quadratic"], bends["cubic"])
    shown("whole matrix: evidence of quadratic or cubic, nats", worst, "refused", not control["causes"])


def imucal(folder: Path) -> None:
    """Six labelled faces of a real sensor, beside imucal's own answer."""
    table = recordings.session(folder)
    ours = tumble.calibrate_unit(tumble.recipe("six-point"), recordings.faces(table, recordings.IMUCAL_G), tumble.TODAY)
    assert ours.budget is not None
    std = ours.budget.std()
    off = tumble.coefficients(ours) - recordings.imucals(table)
    theirs = std.copy()
    theirs[:3] *= np.sqrt(3)
    print(f"six faces of a real sensor, imucal {version('imucal')}; offsets in mg, gains and cross-axis in 1e-3")
    worst = float(np.abs(off / np.hypot(std, theirs)).max())
    shown("largest difference over its standard uncertainty", worst, "< 1.96", worst < 1.96)
    shown("our offset uncertainty over that of imucal's formula", std[0] / theirs[0], "< 1", std[0] < theirs[0])
    rest = 1e3 * np.abs(off[3:]).max()
    print(f"    offsets differ by {np.round(1e3 * off[:3], 2)}, stated {1e3 * std[0]:.2f}; the rest by < {rest:.1g}")


if __name__ == "__main__":
    main()
