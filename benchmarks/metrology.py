"""What uncertainties are worth: coverage, false accepts, risks, capability intervals, certificates.

    python benchmarks/metrology.py [--units 1000] [--only NAME] [--seed 0]

Units, poses, noise and converters are made in metrology_rows by formulas of their own; nothing of the product but the
recipe, the samples table and the calibration is used. Coverage is the share of coefficients (that the method estimates)
whose truth lies within the U that is stated. Seeds are fixed and printed with every row.
"""

import argparse
import platform
import time
from collections.abc import Callable
from datetime import UTC, datetime

import numpy as np
from metrology_rows.bound import bound
from metrology_rows.certificates import certificates
from metrology_rows.indices import indices
from metrology_rows.kinds import kinds
from metrology_rows.poses import poses, sites, taught, tilts, white
from metrology_rows.readings import clipped, rounding, slow, taken_for_granted
from metrology_rows.report import Report
from metrology_rows.risks import learnt, risks

from station import __version__
from station.domain.methods import uncertainty

ROWS: dict[str, Callable[[int, Report], None]] = {
    "white": white, "bound": bound, "tilts": tilts, "taught": taught, "poses": poses, "rounding": rounding,
    "method": taken_for_granted, "slow": slow, "sites": sites, "clipped": clipped, "risks": risks, "learnt": learnt,
    "kinds": kinds, "indices": indices, "certificates": certificates,
}  # fmt: skip


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
    report = Report(options.seed, tuple(options.xsd or ()))
    print(f"Validation of uncertainties and decisions, {datetime.now(UTC):%Y-%m-%d %H:%M} UTC, U for 95 %")
    print(
        f"station {__version__}, rules {uncertainty.RULES}, python {platform.python_version()}, numpy {np.__version__}"
    )
    for name in options.only or ROWS:
        begun = time.perf_counter()
        print(f"{name}: {options.units} units a case")
        ROWS[name](options.units, report)
        print(f"  ({time.perf_counter() - begun:.0f} s)")
    report.summary()


if __name__ == "__main__":
    main()
