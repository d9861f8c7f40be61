"""Whether units, taken in portions, show any gross fault at all; a tone of the motors is searched in all of them
together."""

import numpy as np
from numpy.typing import NDArray

from station.diagnosis.data.faults import axis_decoding, clipping, clock, counters, grid_step, stuck_bits
from station.domain.core.types import SampleTable
from station.domain.recipe.recipe import Recipe
from station.model.scene import visits_scene_of_table


class HealthyUnits:
    """Units that were examined without a finding."""

    def __init__(self, recipe: Recipe) -> None:
        """The recipe says what the device should do."""
        self._recipe = recipe
        self._codes: list[stuck_bits.AxisCodes] = []

    def add(self, table: SampleTable, visit: NDArray[np.intp]) -> bool:
        """Whether neither the new units nor all so far together show anything; visit (n) of each row."""
        recipe = self._recipe
        if clipping.clipped(table, visit)[0]:
            return False
        count = np.bincount(visit)
        mean = np.stack([np.bincount(visit, column) / count for column in table.reading.T], axis=1)
        if axis_decoding.wrong_decodings(visits_scene_of_table(recipe, table), mean, ()):
            return False
        if any(part.faults(recipe, table, visit) for part in (grid_step, clock)):
            return False
        if "counter" in table.values and not counters.tally(table, visit, recipe.device.counter_bits).is_whole:
            return False
        return not self._bits_stick(table)

    def _bits_stick(self, table: SampleTable) -> bool:
        """Whether a bit reads the same in one of the units, or in all so far."""
        if self._recipe.device.lsb <= 0:
            return False
        units = list(stuck_bits.codes_of_units(table, self._recipe.device.lsb).values())
        self._codes = [stuck_bits.together([*self._codes, *units])]
        return bool(stuck_bits.stuck_in_all(self._codes[0])) or any(map(stuck_bits.stuck_in_unit, units))
