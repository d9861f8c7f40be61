"""What uncertainties are worth: coverage, false accepts, risks, capability intervals, certificates.

    python benchmarks/metrology.py [--units 1000] [--only NAME] [--seed 0]

Units, poses, noise and converters are made in metrology_rows by formulas of their own; nothing of the product but the
recipe, the samples table and the calibration is used. Coverage is the share of coefficients (that the method estimates)
whose truth lies within the U that is stated. Seeds are fixed and printed with every row.
"""

import argparse
import hashlib
import platform
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import scipy
from metrology_rows.bound import bound
from metrology_rows.certificates import certificates
from metrology_rows.indices import indices
from metrology_rows.kinds import kinds
from metrology_rows.poses import poses, runs, sites, taught, tilts, white
from metrology_rows.readings import clipped, rounding, slow, taken_for_granted, warmed
from metrology_rows.report import Report
from metrology_rows.risks import learnt, risks

import station
from station import __version__
from station.domain.methods import uncertainty

ROWS: dict[str, Callable[[int, Report], None]] = {
    "white": white, "bound": bound, "tilts": tilts, "taught": taught, "poses": poses, "runs": runs,
    "rounding": rounding, "method": taken_for_granted, "temperature": warmed, "slow": slow,
    "sites": sites, "clipped": clipped, "risks": risks, "learnt": learnt,
    "kinds": kinds, "indices": indices, "certificates": certificates,
}  # fmt: skip

#: What each section is validated against.
ABOUT = {
    "white": "noise alone; closed form, Student's t (JCGM 100, annex G)",
    "bound": "least coverage of any rule, by linear programs (docs/uncertainty.md)",
    "tilts": "nest and base off as stated: shared errors (JCGM 100, 5.2)",
    "taught": "six faces after 100 units in the log",
    "poses": "poses and other scatter that nobody stated (Type A)",
    "runs": "offsets that differ from run to run, as stated (Type B)",
    "rounding": "converters (JCGM 100, F.2.2.1 and F.2.4.5; JCGM 101)",
    "method": "what a method takes for granted (Type B)",
    "temperature": "temperature coefficients and a thermometer that nobody states (Type B)",
    "slow": "noise that a dwell hardly sees",
    "sites": "gravity elsewhere than at the recipe's site",
    "clipped": "readings beyond the range",
    "risks": "specific consumer's risks, process stated (JCGM 106)",
    "learnt": "the same, process learnt from results (JCGM 106)",
    "kinds": "magnetometers, gyroscopes, inclinometers",
    "indices": "Cp, Cpk (ISO 22514-2) and gauge R&R (AIAG MSA-4): intervals",
    "certificates": "digital calibration certificates (PTB DCC)",
}
METHOD = """
Method: Monte Carlo (JCGM 101). Truths, poses, noise and converters are drawn by formulas that share no line with the
product's; the product sees a recipe and a table of readings, as from a bench. A coefficient is covered when its truth
is within the U (95 %) that the product states. "accept at limit": share of units exactly at a limit that a guard band
for a false accept of 1 % would accept; no more than 0.0115. After ± stand two standard deviations of the figure by its
number of units. A goal is met when the figure itself is within it, whatever ± is. Nothing here is a measurement: what a
bench does that no generator draws is not validated."""


def source_digest() -> str:
    """Of the package's source files, by name and content."""
    digest, root = hashlib.sha256(), Path(station.__file__).parent
    for file in sorted(root.rglob("*.py")):
        digest.update(file.relative_to(root).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


def main() -> None:
    """Prints every row."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0, help="Added to the seed of every row.")
    parser.add_argument("--only", action="append", choices=list(ROWS))
    parser.add_argument(
        "--xsd",
        action="append",
        help="A DCC schema with its imports beside it (3.3.0, 3.2.1); none is part of this project.",
    )
    options = parser.parse_args()
    report, chosen = Report(options.seed, tuple(options.xsd or ())), options.only or list(ROWS)
    print(f"VALIDATION OF UNCERTAINTIES AND DECISIONS, {datetime.now(UTC):%Y-%m-%d %H:%M} UTC")
    print(f"Software: station {__version__}, source SHA-256 {source_digest()}, rules {uncertainty.RULES} of the budget")
    by = f"python {platform.python_version()}, numpy {np.__version__}, scipy {scipy.__version__}"
    print(f"By: {by}, {platform.platform()}")
    print(f"Seeds: those of each row plus {options.seed}; {options.units} units a case. Sections: {', '.join(chosen)}")
    print(METHOD)
    for name in chosen:
        begun = time.perf_counter()
        print(f"\n{name}: {ABOUT[name]}")
        ROWS[name](options.units, report)
        print(f"  ({time.perf_counter() - begun:.0f} s)")
    report.summary(tuple(name for name in ROWS if name not in chosen))


if __name__ == "__main__":
    main()
