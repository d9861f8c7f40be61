"""A compass that was turned all round, in a table whose accelerometer saw no tumble: a compass need not rest."""

import numpy as np

from station.domain.recognition import columns, visits
from station.domain.recognition.quantities import QUANTITIES, from_magnitude
from station.domain.recognition.raw_table import ImportOptions, RawTable
from station.errors import SamplesError


def turned_compass(table: RawTable, options: ImportOptions) -> tuple[str, ...]:
    """The columns, as `--columns` takes them, that go round one ellipsoid as a field does; () where none do."""
    quantity = QUANTITIES["uT"]
    try:
        roles = columns.assign(table, options, quantity)
    except SamplesError:
        return ()
    reading = np.stack([table.numbers(i) for i in roles.axes], axis=1)
    reading = reading[np.isfinite(reading).all(axis=1)]
    # Without a name the size must be a field's: quaternions, too, go round a sphere.
    known = roles.rank < columns.NAMELESS or from_magnitude(reading, quantity, whole=False).unit != "LSB"
    if not (known and visits.is_pose_each(reading, any_offset=True)):
        return ()
    return tuple(table.columns[i].name if table.named else str(i) for i in roles.axes)
