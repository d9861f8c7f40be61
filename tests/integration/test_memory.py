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
