"""Offsets by preset commands (CiA 410): reached to the count, put back and recovered as written ones are."""

import shutil
from pathlib import Path

import pytest
from pydantic import ValidationError

from station.domain.core.types import Outcome
from station.domain.product.device_map import DeviceMap
from station.domain.product.preset import preset_axes
from tests.fakes import fixture_run
from tests.fakes.fixture_run import Ran
from tests.fakes.killed_run import killed

OFFSETS = ("6013:00", "6023:00")
PRESET = {"command": {"index": 0x6012, "sub": 0}, "reading": {"index": 0x6010, "sub": 0}}
#: Dies before or just after these calls: when a preset of either axis is worked out, at each record of a write
#: or of the save, and at the reset.
DEATHS = [("preset", "_preset", n) for n in (1, -1, 2, -2)]
DEATHS += [("store", "write", n) for n in (1, -1, 2, -2, 3, -3, 4, -4, 5)] + [("device", "nmt", -2)]


def recipe(folder: Path, noise: float = 0.0005) -> str:
    device = {"rate_hz": 100, "clock_tolerance_ppm": 200, "lsb": 0.01, "full_scale": 30, "axes": 2}
    sheet = {**device, "noise_density": noise, "convention": "horizon"}
    changed = {"product": "siko-ik360", "device": sheet, "limits": {"rule": "simple", "offset": 5.0}}
    return fixture_run.recipe(folder, "inclinometer-zero", **changed)


def offsets(ran: Ran) -> list[object]:
    """What the flash holds; None: it never saved."""
    memory = ran.memory("SN0001")
    return [memory.get(place) for place in OFFSETS]


@pytest.fixture(scope="module")
def preset(tmp_path_factory: pytest.TempPathFactory) -> Ran:
    """A run whose readings carry noise of more than a count."""
    folder = tmp_path_factory.mktemp("preset")
    return fixture_run.run(folder, recipe=recipe(folder, noise=0.002))


def test_an_offset_is_reached_to_the_count_though_readings_carry_noise(preset: Ran) -> None:
    assert (preset.results["SN0001"].outcome, preset.results["SN0001"].reasons) == (Outcome.PASS, ())
    writes = [
        w for w in preset.life("SN0001")["writes"] if w["name"].startswith("offset.") and w["stage"] == "verified"
    ]
    assert [w["name"] for w in writes] == ["offset.x", "offset.y"]
    assert all(w["read_back"] == w["written"] for w in writes)
    held = offsets(preset)
    assert all(isinstance(count, int) and count for count in held)


def test_a_refused_preset_ends_the_unit_and_the_flash_stays_as_it_was(tmp_path: Path) -> None:
    ran = fixture_run.run(tmp_path, recipe=recipe(tmp_path), faults=("refuse:index=0x6022,code=0x08000022",))
    found = ran.results["SN0001"]
    assert (found.outcome is Outcome.PASS, found.written) == (False, False)
    assert "0x6022" in found.reasons[0].sentence
    assert offsets(ran) == [None, None]


@pytest.mark.parametrize(("port", "method", "number"), DEATHS)
def test_after_a_death_the_next_start_knows_what_it_holds(
    preset: Ran, tmp_path: Path, port: str, method: str, number: int
) -> None:
    shutil.copytree(preset.folder, tmp_path, dirs_exist_ok=True)
    old, again = offsets(preset), recipe(tmp_path)
    assert killed(tmp_path, port, method, number, again) == 137
    held = offsets(Ran(tmp_path))
    planned = Ran(tmp_path).stored("SN0001", "write-plan")
    ran = fixture_run.run(tmp_path, seed=3, recipe=again)
    assert ran.notices
    assert ran.results["SN0001"].outcome is Outcome.PASS, ran.results["SN0001"].reasons
    if planned is None or held == old:
        return
    wanted = [int.from_bytes(bytes.fromhex(planned["objects"][place]), "little", signed=True) for place in OFFSETS]
    assert held == wanted, "flash is written whole or not at all"


@pytest.mark.parametrize("stores", ["forward", "inverse-add"])
def test_what_the_station_sends_is_what_the_formula_of_the_profile_needs(stores: str) -> None:
    """offset = preset - slope measured - differential offset, in the profile's own words; its slope is their sum."""
    offset = {
        "index": 0x6013,
        "sub": 0,
        "axes": 1,
        "type": "INT16",
        "scale": 0.01,
        "sign": -1 if stores == "forward" else 1,
    }
    part = {"axes": 1, "type": "INT16", "scale": 0.01}
    blocks = {name: {**place, **part} for name, place in PRESET.items()}
    made = DeviceMap.model_validate(
        {"stores": stores, "offset": offset, "preset": blocks, "output": "none", "sends": "raw"}
    )
    (axis,) = preset_axes(made).values()
    physical, differential, held, wanted = 731, 25, -112, 340
    slope = physical + held + differential
    command = axis.preset_for(_int16(slope), _int16(held), _int16(wanted))
    assert int.from_bytes(command, "little", signed=True) - physical - differential == wanted
    assert axis.offset_after(_int16(slope), _int16(held), command) == _int16(wanted)


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"offset": None}, "add `offset`"),
        ({"save": None}, "name the `save` command"),
        ({"preset": {**PRESET, "command": {"index": 0x6012, "axes": 1}}}, "command has 1 axes, offset 3"),
    ],
)
def test_a_map_that_could_not_be_kept_is_refused(changed: dict[str, object], sentence: str) -> None:
    with pytest.raises(ValidationError, match=sentence):
        DeviceMap.model_validate(
            {"offset": {"index": 0x6013}, "preset": PRESET, "output": "none", "sends": "raw", **changed}
        )


def _int16(value: int) -> bytes:
    return value.to_bytes(2, "little", signed=True)
