"""Firmware: refused before the first byte where it is not for the device, whole or not at all wherever it is cut."""

import hashlib
import json
import zlib
from pathlib import Path
from typing import Any

import pytest
import yaml

from station.cli.app import run_command
from station.domain.core.types import Outcome
from station.domain.product.firmware import FirmwareImage
from station.errors import ProductError, StationError, UnitFault, WrongProduct
from station.messages import Message
from station.service.flash import ProgramDownload, read_software_id
from tests.fakes import fixture_run
from tests.fakes.device_rig import DeviceRig

#: Bytes of a block: 127 segments of seven.
BLOCK = 889
IMAGE = b"2.1.0".ljust(16, b"\0") + bytes(range(256)) * 16
BLOCKS = -(-len(IMAGE) // BLOCK)
OLD, NEW = zlib.crc32(b"1.0.0"), zlib.crc32(IMAGE)


def image(**more: Any) -> FirmwareImage:
    given = {"image": "app.bin", "sha256": hashlib.sha256(IMAGE).hexdigest(), "identity": {"vendor": 0xCA1B0}}
    return FirmwareImage.model_validate({"schema": "station.firmware/1", **given, **more})


def flash(rig: DeviceRig, wrong: tuple[Message, ...] = (), **more: Any) -> str:
    download = ProgramDownload(rig.station, rig.clock, image(**more), IMAGE, lambda _: None)
    return download.run(5.0, lambda: wrong).how


def test_a_download_runs_after_the_restart_and_is_left_alone_the_next_time() -> None:
    rig = DeviceRig()
    rig.clock.sleep(0.5)
    assert flash(rig) == "flashed"
    assert read_software_id(rig.station) == NEW
    assert rig.station.upload(0x100A, 0) == b"2.1.0"
    assert flash(rig) == "stays"


def test_a_wrong_image_is_refused_before_the_first_byte() -> None:
    rig = DeviceRig()
    rig.clock.sleep(0.5)
    rig.heard()
    with pytest.raises(WrongProduct, match="Nothing was written"):
        flash(rig, (Message("firmware-other-hardware", read="A1", allowed=("B*",)),))
    assert rig.heard() == []


@pytest.mark.parametrize("block", range(BLOCKS))
def test_power_lost_in_any_block_leaves_the_old_program_and_the_next_try_goes_on(block: int) -> None:
    """The cut meets the request that begins the transfer, or a segment of that block."""
    rig = DeviceRig(faults=(f"power-cut:index=0x1f50,at={2 + 127 * block},seconds=0.2",))
    rig.clock.sleep(0.5)
    with pytest.raises(StationError):
        flash(rig)
    rig.clock.sleep(1.0)
    assert rig.device.objects.program.software_id == OLD
    fresh = DeviceRig(memory=rig.memory)
    fresh.clock.sleep(0.5)
    assert flash(fresh) == "flashed"
    assert read_software_id(fresh.station) == NEW


@pytest.mark.parametrize("at", ["index=0x1f51,at=1", "index=0x1f51,at=2", "index=0x1f51,at=3", "index=0x1f57,at=3"])
def test_power_lost_at_a_command_leaves_one_of_both_programs(at: str) -> None:
    rig = DeviceRig(faults=(f"power-cut:{at},seconds=0.2",))
    rig.clock.sleep(0.5)
    with pytest.raises(StationError):
        flash(rig)
    rig.clock.sleep(1.0)
    assert rig.device.objects.program.software_id in (OLD, NEW)


def test_a_frame_lost_in_every_block_is_sent_again() -> None:
    lost = tuple(f"lost-segment:index=0x1f50,at={20 + 127 * block},times=1" for block in range(BLOCKS))
    rig = DeviceRig(faults=lost)
    rig.clock.sleep(0.5)
    assert flash(rig) == "flashed"


def test_a_program_that_identifies_itself_otherwise_is_no_success() -> None:
    rig = DeviceRig()
    rig.clock.sleep(0.5)
    with pytest.raises(UnitFault, match="not as 0x00000007"):
        flash(rig, software_id=7)


def test_data_without_a_clear_are_refused() -> None:
    rig = DeviceRig()
    rig.clock.sleep(0.5)
    with pytest.raises(UnitFault, match="state"):
        rig.station.download(0x1F50, 1, IMAGE)


def written(folder: Path, **more: Any) -> list[str]:
    """A firmware file in a folder, and the command that flashes it into a simulated unit."""
    (folder / "app.bin").write_bytes(IMAGE)
    document = image(**more).model_dump(by_alias=True, exclude_none=True, mode="json")
    (folder / "firmware.yaml").write_text(yaml.safe_dump(document))
    unit = ["--serial", "SN0042", "--simulate", "--device-state", str(folder / "devices")]
    return ["flash", str(folder / "firmware.yaml"), *unit]


def test_the_command_flashes_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_command([*written(tmp_path), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["how"], document["version"], document["software_id"]) == ("flashed", "2.1.0", NEW)
    assert run_command(written(tmp_path)) == 0
    assert "runs this image already" in capsys.readouterr().out
    assert flashes(capsys) == [("intended", None), ("flashed", "2.1.0"), ("intended", None), ("stays", "2.1.0")]
    assert run_command(["audit", "SN0042"]) == 0
    assert "app.bin flashed 2.1.0" in capsys.readouterr().out
    assert run_command(["audit", "--verify"]) == 0


def flashes(capsys: pytest.CaptureFixture[str]) -> list[tuple[str, str | None]]:
    """How each flash of the unit went, and the version it named, as the audit knows it."""
    capsys.readouterr()
    assert run_command(["audit", "SN0042", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["flashes"]
    assert {flash["image_sha256"] for flash in found} == {hashlib.sha256(IMAGE).hexdigest()}
    return [(flash["how"], flash.get("version")) for flash in found]


@pytest.mark.parametrize(
    ("more", "error", "says"),
    [
        ({"hardware": ["B*"]}, WrongProduct, "its hardware is 'A1'"),
        ({"identity": {"vendor": 1}}, WrongProduct, "vendor is 0xCA1B0, not 0x1"),
        ({"sha256": "0" * 64}, ProductError, "has SHA-256"),
        ({"image": "other.bin"}, ProductError, "cannot be read"),
    ],
)
def test_the_command_refuses_what_does_not_fit(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    more: dict[str, Any],
    error: type[StationError],
    says: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error, match=says):
        run_command(written(tmp_path, **more))
    if error is WrongProduct:
        assert flashes(capsys) == [("intended", None), ("refused", None)]


@pytest.mark.parametrize(
    ("gate", "outcome", "says"),
    [
        ({"versions": ["1.*"], "software_id": OLD}, Outcome.PASS, ""),
        ({"versions": ["2.*"]}, Outcome.FAIL, "its version is '1.0.0', not 2.*"),
        ({"software_id": 5}, Outcome.FAIL, "not 0x00000005"),
    ],
)
def test_a_run_takes_only_units_with_the_firmware_of_the_recipe(
    tmp_path: Path, gate: dict[str, Any], outcome: Outcome, says: str
) -> None:
    short = {"dwell": {"time_s": 0.1}, "settle": {"time_s": 0.05}, "verify": None, "limits": {}}
    ran = fixture_run.run(tmp_path, recipe=fixture_run.recipe(tmp_path, "one-point", firmware=gate, **short))
    r = ran.results["SN0001"]
    assert r.outcome is outcome, r.reasons
    assert says in (r.reasons[0].sentence if r.reasons else "")
