"""Breaks a firmware download off in every block, and at every command; the device must boot old or new.

    python tests/endurance/flash_cuts.py [--kib N] [--step N] [--first K]

--kib: size of the image (256); --step, --first: of the blocks each N-th, from block K on. In each block once the device
loses power and once the station dies; then the device starts again, says which program it runs, and the same download
must go on to its end. Before that one whole download is timed against its frames on a wire of 500 kbit/s.
"""

import argparse
import hashlib
import random
import sys
import time
import zlib
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from station.adapters.canopen.canopen_device import CanopenDevice
from station.adapters.canopen.network import ServiceNetwork, service_ids
from station.adapters.canopen.sdo_transfer import SEGMENT_BYTES
from station.adapters.simulated_device.nonvolatile import NonVolatileMemory
from station.domain.product.firmware import FirmwareImage
from station.errors import StationError
from station.service.flash import ProgramDownload, read_software_id
from tests.fakes.device_rig import DeviceRig
from tests.fakes.lss_fleet import WIRE_S

BLOCK_BYTES, BLOCK_FRAMES, GOAL = 889, 127, 1.15
#: Frames that the station sends before the first segment: software id, stop, status, clear, status, begin.
HEAD_FRAMES = 6
OLD = zlib.crc32(b"1.0.0")
#: Requests at which a command is cut: program control and status.
COMMANDS = ("index=0x1f51,at=1", "index=0x1f51,at=2", "index=0x1f51,at=3", "index=0x1f57,at=3")


def image_of(data: bytes) -> FirmwareImage:
    """The file that would stand beside these bytes."""
    sha256 = hashlib.sha256(data).hexdigest()
    given = {"image": "app.bin", "sha256": sha256, "identity": {"vendor": 0xCA1B0}}
    return FirmwareImage.model_validate({"schema": "station.firmware/1", **given})


class StationKilled(Exception):
    """The station's process ends before this frame leaves."""


class CountedStation:
    """The station opposite a device; dies before its frame number `dies_at` (None: never)."""

    def __init__(self, rig: DeviceRig, dies_at: int | None = None) -> None:
        self.sent, self._rig, self._dies_at = 0, rig, dies_at
        network = ServiceNetwork(rig.bus.service(service_ids((rig.node,))), rig.clock, self._count)
        self.device = CanopenDevice(network, rig.node, answer_s=rig.answer_s)

    def download(self, data: bytes) -> float:
        """The whole command; seconds of its download."""
        return (
            ProgramDownload(self.device, self._rig.clock, image_of(data), data, lambda _: None)
            .run(5.0, tuple)
            .download_s
        )

    def _count(self, _can_id: int, _data: bytes) -> None:
        if self.sent == self._dies_at:
            raise StationKilled
        self.sent += 1


def broken_off(data: bytes, fault: str | None, dies_at: int | None = None) -> str:
    """What runs afterwards, and once the download has gone on: old, new or neither, twice."""
    rig = DeviceRig(faults=() if fault is None else (fault,), memory=NonVolatileMemory())
    rig.clock.sleep(0.5)
    new = zlib.crc32(data)
    names = {OLD: "old", new: "new"}
    try:
        CountedStation(rig, dies_at).download(data)
    except (StationError, StationKilled):
        rig.clock.sleep(1.0)
    rig.device.reset()
    rig.clock.sleep(0.5)
    booted = names.get(read_software_id(rig.station) or 0, "neither")
    fresh = DeviceRig(memory=rig.memory)
    fresh.clock.sleep(0.5)
    CountedStation(fresh).download(data)
    return f"{booted}, {names.get(read_software_id(fresh.station) or 0, 'neither')}"


def over_wire(data: bytes) -> tuple[float, float]:
    """(time ÷ wire, the same with the processor's time of station and simulated device added as if nothing of it ran
    while frames are on the wire) of a whole download; the simulated bus itself takes no time."""
    rig = DeviceRig()
    rig.clock.sleep(0.5)
    station, began_s = CountedStation(rig), time.process_time()
    simulated_s = station.download(data)
    processor_s = time.process_time() - began_s
    blocks, segments = -(-len(data) // BLOCK_BYTES), -(-len(data) // SEGMENT_BYTES)
    wire_s = (segments + blocks + 4) * WIRE_S  # one answer a block; begin and end have two frames each
    frames_s = (station.sent - segments) * WIRE_S + wire_s
    return (frames_s + simulated_s) / wire_s, (frames_s + simulated_s + processor_s) / wire_s


def main() -> int:
    """Prints the counts; 1 when a device booted neither, a download did not go on, or it took too long."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kib", type=int, default=256)
    parser.add_argument("--step", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    given = parser.parse_args()
    data = b"2.1.0".ljust(16, b"\0") + random.Random(1).randbytes(given.kib * 1024 - 16)
    blocks = range(given.first, -(-len(data) // BLOCK_BYTES), given.step)
    began_s = time.monotonic()
    ratio, ratio_with_processor = over_wire(data)
    print(
        f"{given.kib} KiB: time / wire {ratio:.3f}   goal: {GOAL}; with the processor's time of station and simulated "
        f"device added: {ratio_with_processor:.3f}"
    )
    cuts = [f"index=0x1f50,at={2 + BLOCK_FRAMES * block}" for block in blocks] + list(COMMANDS)
    found = [broken_off(data, f"power-cut:{where},seconds=0.2") for where in cuts]
    found += [broken_off(data, None, HEAD_FRAMES + BLOCK_FRAMES * block) for block in blocks]
    wrong = [line for line in found if line not in ("old, new", "new, new")]
    print(
        f"{given.kib} KiB, {len(blocks)} blocks: power cut in each and at {len(COMMANDS)} commands, station killed in "
        f"each: neither program, or the download does not go on: {len(wrong)} of {len(found)}   goal: 0   "
        f"({time.monotonic() - began_s:.0f} s)"
    )
    return int(bool(wrong) or ratio > GOAL)


if __name__ == "__main__":
    sys.exit(main())
