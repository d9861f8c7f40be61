"""A run on a device that nobody here wrote: identified, measured, written, saved, reset, read back, verified."""

import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
from vcan_harness import fixture
from vcan_harness.interface import Interface
from vcan_harness.node import NodeDevice, NodeMaster

from station.domain.core.types import Outcome
from station.domain.run.progress import Identified

NODE = 0x11
MATRIX = [1.01, 0.004, 0.0, -0.003, 0.985, 0.005, 0.002, 0.0, 1.02]
OFFSET_G = [0.02, -0.03, 0.01]
NOISE_G = 0.0003


def test_the_foreign_device_is_taken_from_label_to_pass(
    vcan: Interface,
    node_device: Callable[..., NodeDevice],
    node_master: Callable[[Interface], NodeMaster],
    tmp_path: Path,
) -> None:
    flash = tmp_path / "flash.json"
    unit = node_device(
        vcan, node=NODE, serial=42, matrix=MATRIX, offset_g=OFFSET_G, noise_g=NOISE_G, flash=str(flash),
        event_ms=round(1000 / fixture.RATE_HZ),
    )  # fmt: skip
    with fixture.opened(tmp_path, vcan, (NODE,), positioner=fixture.DRIVEN) as bench:
        ran = fixture.run(bench, ["SN0042"], lambda true: unit.turn(true.tolist()))
    r = ran.results["SN0042"]
    assert r.reasons == ()
    assert (r.outcome, r.written, r.verified) == (Outcome.PASS, True, True)
    (who,) = [e for e in ran.events if isinstance(e, Identified)]
    assert (who.name, who.software, who.device_serial) == ("accelerometer", "canopen 6.2.1", 42)
    assert r.fit is not None
    assert r.fit.calibration is not None
    matrix, offset = r.fit.calibration.matrix, r.fit.calibration.offset
    # Twenty readings a face, two faces an axis: five standard errors, and half a step of quantization.
    tolerance = 5 * NOISE_G / np.sqrt(20) + 0.5 / 16000
    np.testing.assert_allclose(matrix, np.reshape(MATRIX, (3, 3)), rtol=0, atol=tolerance)
    np.testing.assert_allclose(offset, OFFSET_G, rtol=0, atol=tolerance)
    saved = json.loads(flash.read_text())["objects"]
    master = node_master(vcan)
    for at, value in enumerate([*matrix.ravel(), *offset]):
        index, sub = (0x2101, at + 1) if at < 9 else (0x2102, at - 8)
        assert master.upload(NODE, index, sub) == struct.pack("<f", value)
        assert struct.pack("<f", saved[f"{index:04x}:{sub:02x}"]) == struct.pack("<f", value)
    observed = [e for e in unit.events if e["event"] in ("saved", "boot-up")]
    assert [e["event"] for e in observed] == ["boot-up", "saved", "boot-up"]
