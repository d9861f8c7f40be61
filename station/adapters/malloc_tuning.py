"""How the C library deals with memory that is given back: a station keeps it, for the next dwell asks for as much."""

import ctypes
from collections.abc import Mapping
from typing import Final

#: From <malloc.h>.
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_MMAP_MAX = -1, -3, -4
#: Arrays up to this size, 20 s of a full 1 Mbit/s bus, come out of memory that is at hand.
LARGEST_BYTES: Final = 4 << 20
#: So much free memory stays with the process; the decoding of 20 s of a full bus needs no more.
RETAINED_BYTES: Final = 32 << 20


def retain_freed_memory() -> bool:
    """Lets this process keep memory that it frees, for its next arrays; False where the C library knows no such thing.

    Left alone, glibc hands an array's memory back to the kernel when it is freed, and gets it anew, page by page, each
    cleared and mapped at its first touch: 450 page faults to decode 9,000 frames, every time.
    """
    return _set_malloc_options({_M_MMAP_THRESHOLD: LARGEST_BYTES, _M_TRIM_THRESHOLD: RETAINED_BYTES})


def retain_all_memory() -> bool:
    """The same for arrays of any size, until the process ends: for a command that works through one table and is done.

    An array of more than 32 MiB always comes fresh from the kernel otherwise; in a diagnosis of 400 units that was a
    fifth of the time, in one of 40 units nothing.
    """
    return _set_malloc_options({_M_MMAP_MAX: 0, _M_TRIM_THRESHOLD: 1 << 30})


def release_free_memory() -> bool:
    """Gives the kernel back what lies free between arrays that are still held; False where the C library knows no such
    thing.

    What a table was read with leaves gaps that few later arrays fit: 70 MB after one of 400 units, a fifth of all.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    return trim is not None and bool(trim(0))


def _set_malloc_options(settings: Mapping[int, int]) -> bool:
    change = getattr(ctypes.CDLL(None), "mallopt", None)
    return change is not None and all(change(name, value) for name, value in settings.items())
