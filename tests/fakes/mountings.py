"""Random mountings of a rig: the map says one thing, the rig was built otherwise; units with errors of their own."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from station.adapters.bus.simulated import SimulatedBus
from station.adapters.clock import VirtualClock
from station.adapters.positioner.cia402 import Cia402Positioner
from station.adapters.simulated_device.drive.node import angles_of, drives_of
from station.config.rigs import load_rig
from station.domain.core.types import Floats
from station.domain.rig.commissioning import up_in_nest, with_axes
from station.domain.rig.rig_map import RigMap
from station.service.rig_check import RigCheck, check_rig

#: Standard deviations of a unit's gain (1), cross-axis (1) and offset (g), and of a mean reading (g).
GAIN_STD, CROSS_STD, OFFSET_STD, NOISE_STD = 0.01, 0.002, 0.03, 0.0002


@dataclass(frozen=True)
class Mounting:
    """How the rig was built, against its map. backwards, ratio, zero_deg: of each axis, outer first."""

    swapped: bool
    backwards: tuple[bool, ...]
    ratio: tuple[float, ...]
    zero_deg: tuple[float, ...]

    def true_map(self, rig: RigMap) -> RigMap:
        """The map that would be right: angle = ± ratio · (what the map says) + zero."""
        drives = rig.axes[::-1] if self.swapped else rig.axes
        axes = []
        for i, axis in enumerate(rig.axes):
            drive = drives[i]
            counts = drive.counts_per_deg / self.ratio[i] * (-1 if self.backwards[i] else 1)
            zero = round(drive.zero_counts - self.zero_deg[i] * counts)
            place = {"node": drive.node, "axis": drive.axis, "counts_per_deg": counts, "zero_counts": zero}
            axes.append(axis.model_copy(update=place))
        return with_axes(rig, axes)


def drawn(rng: np.random.Generator) -> Mounting:
    """Swapped or not, signs, ratios of wrong gears, two degrees of zero error either way or none."""
    ratio = rng.choice([1.0, 0.5, 2.0, 0.8, 1.25, 3.0], 2)
    zero = rng.choice([0.0, 2.0, -2.0], 2)
    back = rng.uniform(size=2) < 0.5
    return Mounting(
        bool(rng.uniform() < 0.5), (bool(back[0]), bool(back[1])), tuple(ratio.tolist()), tuple(zero.tolist())
    )


def commission(mounting: Mounting, seed: int, units: int = 2) -> tuple[RigCheck, RigMap]:
    """What `rig check` finds on a rig that was built so, and the map that would be right."""
    rig = load_rig("two-axis")
    true = mounting.true_map(rig)
    clock, rng = VirtualClock(), np.random.default_rng(seed)
    bus = SimulatedBus(clock)
    drives = drives_of(rig, bus.endpoint, clock)
    for drive in drives:
        clock.attach(drive)
    M = (
        np.eye(3)
        + rng.normal(0, CROSS_STD, (units, 3, 3))
        + np.einsum("ui,ij->uij", rng.normal(0, GAIN_STD, (units, 3)), np.eye(3))
    )
    offset = rng.normal(0, OFFSET_STD, (units, 3))

    def read() -> Mapping[str, Floats]:
        """What the units feel now."""
        angles = angles_of(true, drives, np.array([clock.monotonic_s()]))[0]
        up = up_in_nest(true, angles.tolist())
        return {f"SN{u}": M[u] @ up + offset[u] + rng.normal(0, NOISE_STD, 3) for u in range(units)}

    def make(of: RigMap) -> Cia402Positioner:
        return Cia402Positioner(Cia402Positioner.Settings(channel="units"), clock, bus, of)

    return check_rig(rig, make, read, speed_deg_s=90.0), true


def wrong(mounting: Mounting, seed: int) -> list[str]:
    """What `rig check` said that is not so, or did not say; empty where it is right in everything."""
    found, true = commission(mounting, seed)
    said = [m.id for m in found.findings]
    mistakes = []
    if ("rig-axes-swapped" in said) != mounting.swapped:
        mistakes.append("swapped")
    if said.count("rig-axis-backwards") != sum(mounting.backwards):
        mistakes.append("backwards")
    if said.count("rig-axis-ratio") != sum(r != 1 for r in mounting.ratio):
        mistakes.append("ratio")
    if said.count("rig-axis-zero") != sum(z != 0 for z in mounting.zero_deg):
        mistakes.append("zero")
    for got, want in zip(found.corrected.axes, true.axes, strict=True):
        if (got.node, got.axis) != (want.node, want.axis):
            mistakes.append(f"{got.name}: drive")
        if abs(got.counts_per_deg / want.counts_per_deg - 1) > 0.005:
            mistakes.append(f"{got.name}: counts {got.counts_per_deg:.1f} for {want.counts_per_deg:.1f}")
        if abs(got.angle_deg(want.zero_counts)) > 0.5:
            mistakes.append(f"{got.name}: zero off by {got.angle_deg(want.zero_counts):.2f}")
    return mistakes
