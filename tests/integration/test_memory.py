"""Memory that is freed stays at hand: the next arrays of that size need no new pages from the kernel."""

import subprocess
import sys

_MEASURED = """
import resource
import numpy as np
from station.adapters.memory import keep_freed
assert keep_freed()
def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    held = [np.ones(250_000 // 8) for _ in range(20)]
    del held
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
print(faults(), max(faults() for _ in range(5)))
"""


def test_freed_memory_is_used_again() -> None:
    said = subprocess.run([sys.executable, "-c", _MEASURED], check=True, capture_output=True, text=True, timeout=60)
    first, later = map(int, said.stdout.split())
    assert first > 1000  # 5 MB in pages of 4 KiB: the process had no such memory before
    assert later < 50
