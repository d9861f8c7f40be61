"""Memory that is freed stays at hand: the next arrays of that size need no new pages from the kernel."""

import subprocess
import sys

import pytest

_MEASURED = """
import resource
import numpy as np
from station.adapters.malloc_tuning import {how}
assert {how}()
def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    held = [np.ones({size} // 8) for _ in range({count})]
    del held
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
print(faults(), max(faults() for _ in range(5)))
"""


@pytest.mark.parametrize(
    ("how", "size", "count", "least"),
    [
        ("retain_freed_memory", 250_000, 20, 1000),  # 5 MB in pages of 4 KiB
        ("retain_all_memory", 50_000_000, 2, 40),  # 100 MB, at best in pages of 2 MiB
    ],
)
def test_freed_memory_is_used_again(how: str, size: int, count: int, least: int) -> None:
    code = _MEASURED.format(how=how, size=size, count=count)
    printed = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, timeout=60)
    first, later = map(int, printed.stdout.split())
    assert first > least  # the process had no such memory before
    assert later < min(first, 50)


_RELEASED = """
import os
import numpy as np
from station.adapters.malloc_tuning import release_free_memory, retain_all_memory
def resident_MB():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
retain_all_memory()
held = [np.ones(125_000) for _ in range(100)]
del held[::2]
before = resident_MB()
assert release_free_memory()
print(before - resident_MB(), sum(float(x.sum()) for x in held))
"""


def test_memory_between_arrays_that_are_held_is_given_back() -> None:
    printed = subprocess.run(
        [sys.executable, "-c", _RELEASED], check=True, capture_output=True, text=True, timeout=60
    ).stdout.split()
    # Fifty of a hundred arrays of 1 MB were freed, each between two that stay.
    assert float(printed[0]) > 40.0 and float(printed[1]) == 50 * 125_000
