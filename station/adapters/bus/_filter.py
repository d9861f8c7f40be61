"""Which frames a channel receives: the rule the kernel applies, for buses that have no kernel."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from station.domain.core.types import ERROR, EXTENDED, Frames

_FEW_IDS = 16


def accepted_mask(frames: Frames, can_ids: Sequence[int], *, errors: bool) -> NDArray[np.bool_]:
    """Mask (n) of the frames that a channel with these ids receives; no ids: all. Error frames only if asked for."""
    is_error = (frames.can_id & np.uint32(ERROR)) != 0
    if not can_ids:
        chosen = ~is_error
    else:
        # The REMOTE bit is not part of the address: a remote frame is shown, and told apart by whoever decodes.
        address = frames.can_id & np.uint32(EXTENDED | 0x1FFF_FFFF)
        chosen = _is_listed(address, can_ids) & ~is_error
    return np.asarray(chosen | is_error if errors else chosen)


def accepts(can_id: int, can_ids: Sequence[int], *, errors: bool) -> bool:
    """The same for one frame."""
    if can_id & ERROR:
        return errors
    return not can_ids or can_id & (EXTENDED | 0x1FFF_FFFF) in can_ids


def _is_listed(address: NDArray[np.uint32], can_ids: Sequence[int]) -> NDArray[np.bool_]:
    """Mask (n) of the addresses that are listed; a few ids are compared one by one, ten times as fast as np.isin."""
    if len(can_ids) > _FEW_IDS:
        return np.isin(address, np.array(can_ids, np.uint32))
    found = address == np.uint32(can_ids[0])
    for can_id in can_ids[1:]:
        found |= address == np.uint32(can_id)
    return np.asarray(found)
