"""What a line would record of a simulated campaign: the samples table, with the imperfections of the recording."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from station.domain.core.types import Array, Floats, SampleTable
from station.model.effect import BusEffect, random_stream
from station.model.forward import ActiveEffect, ActiveEffects, gold_error, stimulus_in_nest
from station.model.noise import Noise
from station.model.scene import Scene, Signal

#: Noise of the thermometer, degC a sample.
THERMOMETER_STD = 0.02
#: How much quieter the gold is than the unit.
GOLD_NOISE = 0.2
#: Time between a frame and its repetition: one frame on a bus of 500 kbit/s.
REPEAT_S = 0.00025


def samples_table(scene: Scene, reading: Floats, rate_hz: Floats, seed: int) -> SampleTable:
    """The samples table of a plan's scene; rate_hz (U): true sample rates."""
    visits, row = scene.visits, scene.visit
    names = ("temperature_degC", "since_power_s", "since_clamp_s", "motor", "started_s")
    values = {name: scene.require(name) for name in names}
    values["temperature_degC"] = values["temperature_degC"] + thermometer_noise(scene, seed)
    values["counter"] = _counter(scene, rate_hz)
    return SampleTable(
        unit=visits.unit[row],
        run=visits.run[row],
        visit=visits.visit[row],
        position=visits.position[row],
        time_s=scene.time_s,
        reading=reading,
        labels={name: labels[row] for name, labels in {**visits.groups, "seating": visits.seating}.items()},
        values=values,
    )


def sensor_noise(scene: Scene, of: Noise, seed: int) -> Floats:
    """Noise of the sensors (n, 3), each unit's from its own stream."""
    rngs = [random_stream(seed, "noise", name) for name in scene.visits.unit.names]
    rate = scene.recipe.device.rate_hz
    return np.concatenate([of.draw(scene.time_s[rows], rate, rngs[unit]) for unit, rows in run_slices(scene)])


def gold_readings(signal: Signal, active: ActiveEffects, of: Noise, seed: int) -> Floats:
    """Raw readings of the gold (n, 3): what the nest feels, by the gold's own calibration, and its noise."""
    scene, recipe = signal.scene, signal.scene.recipe
    moving = np.einsum("nij,nj->ni", scene.visits.seat_R[scene.visit], signal.true - signal.at_visit[scene.visit])
    felt = (stimulus_in_nest(scene, active) + gold_error(scene, active))[scene.visit] + moving
    if recipe.reference.gold is not None:
        felt = felt @ np.array(recipe.reference.gold.matrix).T + recipe.reference.gold.offset
    sigma = GOLD_NOISE * of.density * np.sqrt(recipe.device.rate_hz / 2)
    rngs = [random_stream(seed, "gold", name) for name in scene.visits.unit.names]
    white = [rngs[unit].standard_normal((rows.stop - rows.start, 3)) for unit, rows in run_slices(scene)]
    return np.asarray(felt + sigma * np.concatenate(white))


def after_bus_faults(sent: SampleTable, scene: Scene, active: ActiveEffects, seed: int) -> SampleTable:
    """The table after the faults of the bus: what is in a frame comes in the order of arrival; time runs on.

    sent: rows as in the scene, sorted by unit.
    """
    sent_index, arrived_index = arrivals(scene, active, seed)
    if len(sent_index) == len(sent) and np.array_equal(arrived_index, sent_index):
        return sent
    rows = sent[sent_index]
    values = {**rows.values, "counter": sent.values["counter"][arrived_index]}
    return replace(
        rows, time_s=rows.time_s + repetition_delay_s(sent_index), reading=sent.reading[arrived_index], values=values
    )


def arrivals(scene: Scene, active: ActiveEffects, seed: int) -> tuple[Array, Array]:
    """Of the frames sent, those whose instants are seen, and those whose payloads come then (both m)."""
    sent_index = arrived_index = np.arange(len(scene))
    for acting in active.values():
        if isinstance(acting.effect, BusEffect):
            order = _order(acting, acting.effect, scene, sent_index, seed)
            sent_index, arrived_index = sent_index[np.sort(order)], arrived_index[order]
    return sent_index, arrived_index


def repetition_delay_s(sent_index: Array) -> Floats:
    """How much later than the frame before a repeated frame is seen (m), s."""
    return np.asarray(REPEAT_S * (np.diff(sent_index, prepend=-1) == 0))


def _order(acting: ActiveEffect, effect: BusEffect, scene: Scene, rows: Array, seed: int) -> Array:
    """Order of arrival of the rows left, each unit's drawn from its own stream."""
    visit = scene.visit[rows]
    unit = scene.visits.unit.code[visit]
    fraction = acting.by_visit(scene)[visit, 0]
    order = []
    for code, name in enumerate(scene.visits.unit.names):
        start, stop = np.searchsorted(unit, [code, code + 1])
        rng = random_stream(seed, effect.id, "frames", name)
        order.append(start + effect.apply(visit[start:stop], fraction[start:stop], rng))
    return np.concatenate(order)


def run_slices(scene: Scene) -> Iterator[tuple[int, slice]]:
    """Unit code and rows of each unit's each run; rows are sorted by visit."""
    for visits in scene.visits.run_slices():
        start, stop = np.searchsorted(scene.visit, [visits.start, visits.stop])
        yield int(scene.visits.unit.code[visits.start]), slice(int(start), int(stop))


def thermometer_noise(scene: Scene, seed: int) -> Floats:
    """Noise of the thermometer (n), degC."""
    rngs = [random_stream(seed, "thermometer", name) for name in scene.visits.unit.names]
    noise = [rngs[unit].standard_normal(rows.stop - rows.start) for unit, rows in run_slices(scene)]
    return np.asarray(THERMOMETER_STD * np.concatenate(noise))


def _counter(scene: Scene, rate_hz: Floats) -> Floats:
    """Frame counter (n): frames since power-on, modulo what its bits can hold; it also counts while moving."""
    first = np.searchsorted(scene.visit, np.arange(len(scene.visits)))
    before = np.rint(scene.require("since_power_s")[first] * rate_hz[scene.visits.unit.code])
    within = np.arange(len(scene)) - first[scene.visit]
    return np.asarray((before[scene.visit] + within) % 2**scene.recipe.device.counter_bits)
