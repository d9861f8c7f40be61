"""Cuts the power in every block of a firmware download, and at every command; the device must boot old or new.

    python tests/endurance/flash_cuts.py [--kib N] [--every N]

--kib: size of the image (256); --every: cut in each N-th block. After each cut the device starts again, says which
program it runs, and the same download must then go on to its end.
"""

import argparse
import hashlib
import random
import sys
import time
import zlib
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from station.adapters.simulated_device.nonvolatile import NonVolatileMemory
from station.domain.product.firmware import FirmwareImage
from station.errors import StationError
from station.service.flash import ProgramDownload, read_software_id
from tests.fakes.device_rig import DeviceRig

BLOCK_BYTES, BLOCK_FRAMES = 889, 127
OLD = zlib.crc32(b"1.0.0")
#: Requests at which a command is cut: program control and status.
COMMANDS = ("index=0x1f51,at=1", "index=0x1f51,at=2", "index=0x1f51,at=3", "index=0x1f57,at=3")


def image_of(data: bytes) -> FirmwareImage:
    """The file that would stand beside these bytes."""
    sha256 = hashlib.sha256(data).hexdigest()
    given = {"image": "app.bin", "sha256": sha256, "identity": {"vendor": 0xCA1B0}}
    return FirmwareImage.model_validate({"schema": "station.firmware/1", **given})


def cut(data: bytes, where: str) -> str:
    """What runs after the cut, and after the download has gone on: old, new or neither, twice."""
    rig = DeviceRig(faults=(f"power-cut:{where},seconds=0.2",), memory=NonVolatileMemory())
    rig.clock.sleep(0.5)
    new = zlib.crc32(data)
    names = {OLD: "old", new: "new"}
    try:
        ProgramDownload(rig.station, rig.clock, image_of(data), data, lambda _: None).run(5.0, tuple)
    except StationError:
        rig.clock.sleep(1.0)
    booted = names.get(rig.device.objects.program.software_id, "neither")
    fresh = DeviceRig(memory=rig.memory)
    fresh.clock.sleep(0.5)
    ProgramDownload(fresh.station, fresh.clock, image_of(data), data, lambda _: None).run(5.0, tuple)
    return f"{booted}, {names.get(read_software_id(fresh.station) or 0, 'neither')}"


def main() -> int:
    """Prints the counts; 1 when a device booted neither or a download did not go on."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kib", type=int, default=256)
    parser.add_argument("--every", type=int, default=1)
    given = parser.parse_args()
    data = b"2.1.0".ljust(16, b"\0") + random.Random(1).randbytes(given.kib * 1024 - 16)
    blocks = range(0, -(-len(data) // BLOCK_BYTES), given.every)
    began_s = time.monotonic()
    found = [cut(data, f"index=0x1f50,at={2 + BLOCK_FRAMES * block}") for block in blocks]
    found += [cut(data, command) for command in COMMANDS]
    wrong = [line for line in found if line not in ("old, new", "new, new")]
    lasted_s = time.monotonic() - began_s
    print(
        f"{given.kib} KiB, cut in {len(blocks)} blocks and at {len(COMMANDS)} commands: "
        f"neither program, or the download does not go on: {len(wrong)}   goal: 0   ({lasted_s:.0f} s)"
    )
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
