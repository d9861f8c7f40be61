"""The harness itself: the way that uses a kernel with CAN, taken from inside such a kernel."""

import sys
from pathlib import Path

from vcan_harness import debian, ways
from vcan_harness.interface import Interface
from vcan_harness.job import Job

_INNER = """
import socket, subprocess, sys
subprocess.run(["ip", "link", "add", "vcan0", "type", "vcan"], check=True)
subprocess.run(["ip", "link", "set", "vcan0", "up"], check=True)
names = sorted(name for _, name in socket.if_nameindex())
open(sys.argv[1], "a").write('{"names": "%s"}\\n' % " ".join(names))
"""


def test_a_kernel_with_can_is_used_as_it_is_and_apart_from_what_it_has(vcan: Interface, tmp_path: Path) -> None:
    way = ways.find(tmp_path, ())
    assert way.name.startswith("this kernel")
    job = Job(way, tmp_path, tmp_path, [sys.executable, "-c", _INNER, str(tmp_path / "reports.jsonl")], {})
    try:
        assert list(job.reports()) == [{"names": "lo vcan0"}], job.last_words()
    finally:
        job.stop()


def test_every_program_comes_from_somewhere() -> None:
    found = debian.provide(ways.CAN_PROGRAMS)
    assert set(found) == set(ways.CAN_PROGRAMS)
    assert all(path.is_file() for path in found.values())
