"""Along what a residual is drawn: position, order, time, temperature, previous position, and which one tells most."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import Floats, Labels
from station.reporting.diagnosis.data import ReportData

#: Steps of a number's axis within which a signature is averaged.
BINS = 24
#: Share of a signature that an axis must order to be the one to draw it on; visits that are drawn one by one.
MIN_EXPLAINED, MAX_SINGLE_VISITS = 0.6, 96
AXIS_LABELS = {
    "time_s": "time within the run, s",
    "temperature_degC": "temperature, °C",
    "temperature_rate": "rate of temperature, °C/s",
    "since_power_s": "time since power-on, s",
    "since_clamp_s": "time since clamping, s",
    "motor": "drive level of the motors",
    "position": "",
    "previous": "position before",
    "order": "visit within the run",
    "unit": "",
    "stops": "visits, one after the other",
}


@dataclass(frozen=True, slots=True, eq=False)
class PlotAxis:
    """A horizontal axis: name, where each visit stands (v, NaN where it has no place), words for the places 0, 1, 2 …;
    single: each visit has a place of its own."""

    name: str
    at: Floats
    places: tuple[str, ...] = ()
    single: bool = False

    def only(self, rows: NDArray[np.bool_]) -> "PlotAxis":
        """The same for some of the visits (v)."""
        return replace(self, at=np.where(rows, self.at, np.nan))

    def bins(self) -> NDArray[np.intp]:
        """Number (v) of the place, or of the step of the axis, of each visit; −1 where it has none."""
        there = np.isfinite(self.at)
        out = np.full(len(self.at), -1, np.intp)
        at = self.at[there]
        if self.places or self.single or len(np.unique(at)) <= BINS:
            out[there] = np.unique(at, return_inverse=True)[1]
        else:
            low, high = float(at.min()), float(at.max())
            out[there] = np.minimum((at - low) / (high - low) * BINS, BINS - 1).astype(np.intp)
        return out


def plot_axis(data: ReportData, name: str) -> PlotAxis | None:
    """An axis by name, None where nobody recorded it or it never changes."""
    if name in ("position", "unit"):
        labels: Labels = getattr(data, name)
        found = PlotAxis(name, labels.code.astype(float), labels.names)
    elif name == "previous":
        before = np.where(data.previous >= 0, data.position.code[data.previous].astype(float), np.nan)
        found = PlotAxis(name, before, data.position.names)
    elif name == "order":
        found = PlotAxis(name, data.visit.astype(float))
    elif name in data.values:
        found = PlotAxis(name, data.values[name])
    else:
        return None
    there = found.at[np.isfinite(found.at)]
    return found if len(there) and float(np.ptp(there)) > 0 else None


def best_axis(data: ReportData, signature: Floats, rows: NDArray[np.bool_], wanted: Sequence[str]) -> PlotAxis | None:
    """The axis that orders a signature best: the wanted one, else that whose steps leave the least of it; where all
    leave much, the visits themselves."""
    found = [a for name in wanted if (a := plot_axis(data, name)) is not None]
    if found:
        return found[0]
    names = ("position", "previous", "unit", "order", *data.values)
    choices = [(_explained(a, signature, rows), a) for name in names if (a := plot_axis(data, name)) is not None]
    share, best = max(choices, key=lambda choice: choice[0], default=(0.0, None))
    return best if share > MIN_EXPLAINED else one_by_one(rows)


def one_by_one(rows: NDArray[np.bool_]) -> PlotAxis | None:
    """The chosen visits (v) one after the other, as many as can be told apart."""
    chosen = np.flatnonzero(rows)[:MAX_SINGLE_VISITS]
    at = np.full(len(rows), np.nan)
    at[chosen] = np.arange(len(chosen))
    return PlotAxis("stops", at, single=True) if len(chosen) > 1 else None


def _explained(axis: PlotAxis, signature: Floats, rows: NDArray[np.bool_]) -> float:
    """Share of a signature's variance that the steps of an axis explain, fairly between few and many steps."""
    bins = np.where(rows, axis.bins(), -1)
    there = bins >= 0
    count = np.bincount(bins[there])
    free = int(there.sum()) - int(np.count_nonzero(count))
    if 2 * free < int(there.sum()):
        # Hardly more visits than steps: anything would look ordered.
        return -np.inf
    values = signature[there] - signature[there].mean(0)
    mean = np.stack([np.bincount(bins[there], column) for column in values.T], 1) / np.maximum(count, 1)[:, None]
    within, total = float(np.sum((values - mean[bins[there]]) ** 2)), float(np.sum(values**2))
    return 1 - within / max(total, 1e-300) * (int(there.sum()) - 1) / free
