"""Coverage where readings are not plain: coarse, slow, clipped, or too few for the model."""

import numpy as np
from metrology_rows.bench import FLOOR, NARROW, Bench
from metrology_rows.designs import NOISE, READINGS, Floats, recipe
from metrology_rows.report import Report


def rounding(units: int, report: Report) -> None:
    """Converters: steps far above the noise, equal to it, truncating; readings that never change."""
    goal = (0.94, 0.97)
    for name, lsb, noise, cut in (
        ("LSB 10 × noise", 0.004, NOISE, "nearest"),
        ("LSB 30 × noise", 0.012, NOISE, "nearest"),
        ("LSB = noise", NOISE, NOISE, "nearest"),
        ("LSB 10 × noise, truncating, stated", 0.004, NOISE, "truncating"),
        ("LSB = noise, truncating, not stated", NOISE, NOISE, "unknown"),
        ("constant readings", 0.004, 0.0, "nearest"),
    ):
        for design in ("six", "n18"):
            bench = Bench(recipe(design, device={"lsb": lsb, "rounding": cut}), units, report, 40)
            values = bench.readings(
                bench.truth(), noise * bench.rng.standard_normal((units, len(bench.poses), READINGS, 3))
            )
            values = lsb * (np.round(values / lsb) if cut == "nearest" else np.floor(values / lsb))
            bench.coverage(f"{name}, {design}", values, goal)
    bench = Bench(recipe("six"), units, report, 41)
    values = 0.004 * np.round(bench.readings(bench.truth(), np.zeros((units, 6, READINGS, 3))) / 0.004)
    bench.coverage("constant readings, no lsb stated, six", values, (0.94, 1.0))


def taken_for_granted(units: int, report: Report) -> None:
    """One-point and three-point with stated spreads of what they do not estimate."""
    stated = {"gain_std": 0.01, "cross_std": 0.005, "rounding": "nearest"}
    for design in ("one", "three"):
        bench = Bench(recipe(design, {"pose_std_deg": 0}, device=stated), units, report, 50)
        bench.matrix = np.eye(3) + np.where(np.eye(3), 0.01, 0.005) * bench.rng.standard_normal((units, 3, 3))
        bench.coverage(f"gain 1 %, cross-axis .5 % stated, {design}", bench.readings(bench.truth()), NARROW)


def slow(units: int, report: Report) -> None:
    """Noise that a dwell hardly sees: first order with .97, and 1/f."""
    for design in ("six", "n18", "norm"):
        for name in ("AR .97", "1/f"):
            bench = Bench(recipe(design), units, report, 60)
            shape = (units, len(bench.poses), 3)
            noise = first_order(bench.rng, shape, 0.97) if name == "AR .97" else one_over_f(bench.rng, shape)
            values = bench.readings(bench.truth(), NOISE * np.moveaxis(noise, -1, 2))
            bench.coverage(f"{name} within dwells, {design}", values, FLOOR)


def first_order(rng: np.random.Generator, shape: tuple[int, ...], phi: float) -> Floats:
    """Unit-variance AR(1) (…, READINGS), stationary."""
    out = np.empty((*shape, READINGS))
    out[..., 0] = rng.standard_normal(shape)
    for i in range(1, READINGS):
        out[..., i] = phi * out[..., i - 1] + (1 - phi**2) ** 0.5 * rng.standard_normal(shape)
    return out


def one_over_f(rng: np.random.Generator, shape: tuple[int, ...]) -> Floats:
    """1/f noise down to a sixteenth of a dwell's frequency, unit standard deviation over all."""
    n = 16 * READINGS
    frequency = np.fft.rfftfreq(n)
    frequency[0] = frequency[1]
    spectrum = (
        rng.standard_normal((*shape, len(frequency))) + 1j * rng.standard_normal((*shape, len(frequency)))
    ) / frequency**0.5
    noise = np.fft.irfft(spectrum, n)[..., :READINGS]
    return np.asarray(noise / noise.std())


def clipped(units: int, report: Report) -> None:
    """Readings cut at a range that no data sheet states; and what is flagged of sound ones."""
    for cut in (0.99, 1.05, np.inf):
        bench = Bench(recipe("six"), units, report, 80)
        values = np.clip(bench.readings(bench.truth()), -cut, cut)
        full = np.abs(bench.readings(bench.truth())).max(axis=(1, 2, 3)) > cut + 3 * NOISE
        flagged = np.array(
            [any(r.check == "clipped" for r in found.verdict.reasons) for found in bench.results(values)]
        )
        if np.isfinite(cut):
            share = float(flagged[full].mean()) if full.any() else 1.0
            report.show(
                f"clipped at {cut:g} g, full scale not stated: flagged", 80, share, (0.99, 1.0), 0.0, f"of {full.sum()}"
            )
        else:
            report.show("sound readings flagged as clipped", 80, float(flagged.mean()), (0.0, 0.001), 0.0)


def warmed(units: int, report: Report) -> None:
    """Offsets and gains that follow the temperature as usual data sheets say, which the recipe does not; it drifts by
    up to 4 °C, and the thermometer is off. Coefficients are to hold at the mean temperature that it shows."""
    for design in ("six", "n18"):
        bench = Bench(recipe(design), units, report, 55)
        rng, v = bench.rng, len(bench.poses)
        real = 23.0 + rng.uniform(-4, 4, (units, 1)) * np.linspace(0, 1, v)
        shown = real + 0.231 * rng.standard_normal((units, 1))
        of_offset, of_gain = 5e-4 * rng.standard_normal((units, 3)), 1e-4 * rng.standard_normal((units, 3))
        values = bench.readings(true := bench.truth())
        values += (of_offset[:, None] * (real - 23.0)[..., None])[:, :, None]
        values += (of_gain[:, None] * true * (real - 23.0)[..., None])[:, :, None]
        held = shown.mean(axis=1, keepdims=True) - 23.0
        bench.offset = bench.offset + of_offset * held
        bench.matrix = bench.matrix + np.einsum("ni,ij->nij", of_gain * held, np.eye(3))
        bench.temperature_degC = shown
        bench.coverage(f"temperature, nothing stated of it, {design}", values, FLOOR)
