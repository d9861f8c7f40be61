"""Does a unit's own thermometer live? One that has stopped inside its limits makes every limit on it worthless."""

from collections.abc import Sequence

import numpy as np

from station.domain.can.sensor_layout import SensorLayout
from station.domain.capture.visit import Visit
from station.messages import Message

#: So many visits tell, seconds and movements apart. A coarser step than this, degC, may stand still in a quiet room.
MIN_VISITS, FINE_DEGC = 6, 0.1


def frozen_warning(visits: Sequence[Visit], layout: SensorLayout) -> Message | None:
    """None or a warning: the reading has not moved by one step over all visits although its steps are fine.

    visits: those of one load. A thermometer whose noise has a standard deviation of one step
    or more shows any one value in no more than 38 % of its readings, so in six running in fewer than one load of a
    hundred; and steps below 0.1 degC are finer than the air of a room is still. It is a warning and no verdict: a
    heavily filtered thermometer may be this quiet.
    """
    step = _step_degC(layout)
    read = [t for visit in visits if len(t := visit.samples.temperature_degC)]
    if step is None or step > FINE_DEGC or len(read) < MIN_VISITS:
        return None
    joined = np.concatenate(read)
    if np.ptp(joined) >= step / 2:
        return None
    return Message("thermometer-frozen", value=float(joined[0]), visits=len(read), step=step)


def _step_degC(layout: SensorLayout) -> float | None:
    role = layout.map.temperature
    if layout.temperature is None or role is None:
        return None
    return abs(float(layout.temperature.signal(role.signal).scale))
