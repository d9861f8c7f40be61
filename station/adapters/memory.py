"""How the C library deals with memory that is given back: a station keeps it, for the next dwell asks for as much."""

import ctypes
from typing import Final

#: From <malloc.h>.
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
#: Arrays up to this size, 20 s of a full 1 Mbit/s bus, come out of memory that is at hand.
LARGEST_BYTES: Final = 4 << 20
#: So much free memory stays with the process; the decoding of 20 s of a full bus needs no more.
KEPT_BYTES: Final = 32 << 20


def keep_freed() -> bool:
    """Lets this process keep memory that it frees, for its next arrays; False where the C library knows no such thing.

    Left alone, glibc hands an array's memory back to the kernel when it is freed, and gets it anew, page by page, each
    cleared and mapped at its first touch: 450 page faults to decode 9,000 frames, every time.
    """
    change = getattr(ctypes.CDLL(None), "mallopt", None)
    if change is None:
        return False
    return bool(change(_M_MMAP_THRESHOLD, LARGEST_BYTES)) and bool(change(_M_TRIM_THRESHOLD, KEPT_BYTES))
