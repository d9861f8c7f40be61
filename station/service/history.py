"""What the log says of process and reproducibility, for the units of the next load."""

import json
from pathlib import Path

import numpy as np

from station.config.settings import Settings
from station.domain.line_quality import history
from station.domain.line_quality.history import NEWEST, NOTHING, History, PastResult
from station.domain.methods import coefficients, uncertainty
from station.domain.product.device_map import DeviceMap
from station.domain.records import stored_attempt
from station.ports.log_reader import LogReader
from station.ports.store import Store, StoredCalibration
from station.service import golden_register


def learnt(
    log: Store | LogReader,
    recipe_hash: str,
    device: DeviceMap | None,
    settings: Settings,
    *,
    simulated: bool | None = None,
) -> History:
    """By the newest attempts with the recipe. Errors: those of the log; ConfigError of the register of golden units.

    simulated: simulated attempts teach simulated ones only; None: as the newest was. Nothing where the device sends
    what it has compensated: a second calibration is then one of another quantity.
    """
    if device is not None and device.sends == "compensated":
        return NOTHING
    rows = log.calibrations(recipe_hash, NEWEST)
    if simulated is None:
        simulated = bool(rows) and stored_attempt.is_simulated(rows[-1].software)
    own = [row for row in rows if stored_attempt.is_simulated(row.software) == simulated]
    results = [r for row in own if (r := _result(row)) is not None]
    if not results:
        return NOTHING
    free = np.any([part for r in results for part in r.parts.values()], axis=0)
    golden = {} if settings.golden is None else golden_register.load(Path(settings.golden.file))
    return history.learn_history(results, free, [unit.serial for unit in golden.values() if unit.kind == "golden"])


def _result(row: StoredCalibration) -> PastResult | None:
    """None where it came to no calibration, or was made before budgets had parts."""
    offset, matrix, budget, residuals, rules = json.loads(row.fit)
    if offset is None or not budget or "parts" not in budget[0]:
        return None
    theta = np.array([*offset, *(v for line in matrix for v in line)], float)
    parts = {cause: np.array([b["parts"].get(cause, 0.0) for b in budget], float) for cause in budget[0]["parts"]}
    if not np.isfinite(theta).all() or len(theta) != len(coefficients.NAMES):
        return None
    day = stored_attempt.utc_day(row.started_ns)
    # What a ratio is in units of is the rules' affair.
    left = (residuals["ratio"], residuals["dof"]) if residuals and rules in uncertainty.SAME_RATIOS else None
    return PastResult(row.serial, f"{row.station}/{row.nest}", day, row.outcome == "PASS", theta, parts, left)
