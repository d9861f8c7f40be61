"""Every shipped product on the virtual bus: written by its own map, it corrects its own readings to the truth."""

import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from station.adapters.simulated_device.stream import SignalChain, SimulatedSensor
from station.adapters.simulated_device.stream_faults import StreamFaults
from station.config.products import load_product
from station.domain.can import signals
from station.domain.can.decode import decode_samples
from station.domain.core.types import Calibration
from station.domain.product import writeback
from tests.fakes.device_rig import DBC, DeviceRig, still

Rig = Callable[..., DeviceRig]
#: Other protocols: tests/conformance/test_object_protocols.py.
PRODUCTS = sorted(path.stem for path in Path(DBC).glob("*.yaml") if load_product(path.stem).map.protocol == "canopen")
A = np.array([[1.02, 0.012, -0.007], [0.011, 0.985, -0.001], [-0.008, 0.003, 1.01]])


@pytest.mark.parametrize("name", [name for name in PRODUCTS if name != "inclinometer"])  # it has no third axis
def test_it_corrects_its_readings_to_the_truth(rig: Rig, name: str) -> None:
    unit = {"accelerometer": 1.0, "magnetometer": 48.0, "gyroscope": 90.0}[name]
    truth, b = unit * np.array([0.36, -0.48, 0.8]), unit * np.array([0.012, -0.003, 0.021])
    device = rig(product_name=name, sense=still(A @ truth + b))
    calibration = Calibration(
        method="n-point",
        unit=device.layout.axes[0].unit,
        offset=b,
        matrix=A,
        covariance=np.zeros((12, 12)),
        positions=(),
        residual=np.zeros((0, 3)),
        tilt_deg=np.zeros(0),
        tilt_std_deg=np.zeros(0),
        disturbed=np.zeros(0, bool),
        residual_rms=0.0,
    )
    writes = writeback.sequence(device.product.map, calibration, temperature_degC=31.25, epoch_ns=10**18)
    for write in writes:
        device.station.download(*write.address, write.raw)
        if write.read_back:
            assert device.station.upload(*write.address) == write.raw, write.name
    written = {write.address: write.raw for write in writes if write.read_back}
    assert device.station.upload(0x2105, 0) == writeback.expected_checksum(device.product.map, written)
    device.station.nmt("start")
    got = decode_samples(device.readings(0.1), device.layout, device.node)
    assert len(got)
    assert got.frame_errors.clean
    step = device.layout.axes[0].scale
    rounding = writeback.rounding_std(device.product.map, b, A)
    # Half a step of converter and output each; √3 standard deviations of every kept number, times what it multiplies.
    stored = np.sqrt(3) * (rounding[:3] + rounding[3:].reshape(3, 3) @ np.abs(truth))
    inverse = np.abs(np.linalg.inv(A))
    bound = inverse @ (np.full(3, 0.5 * step) + 3 * stored) + 0.5 * step + 1e-9
    assert np.all(np.abs(got.xyz[-1] - truth) <= bound), (got.xyz[-1] - truth, bound)


@pytest.mark.parametrize("name", PRODUCTS)
def test_it_is_what_its_product_file_says(rig: Rig, name: str) -> None:
    device = rig(product_name=name)
    read = device.station.identify()
    assert not device.product.mismatches(
        device_type=read.device_type,
        vendor=read.vendor,
        product=read.product,
        revision=read.revision,
        name=read.name,
    )
    (timer,) = device.product.map.settings
    assert struct.unpack("<H", device.station.upload(*timer.address)) == (10,)


def test_a_product_that_sends_floats_is_neither_rounded_nor_clipped(rig: Rig) -> None:
    pattern = rig()
    layout = replace(pattern.layout, sample=_as_floats(pattern.layout.sample))
    frames = StreamFaults((), layout, 5, 0.0)
    readings = SignalChain(SimulatedSensor(layout, still((1e-4, -40_000.0, 3.25)), lambda _: 20.0), frames)
    sent = readings.frames(np.zeros(2), np.zeros(2, np.int64), None, 0.0)
    got = signals.decode(sent, replace(layout.sample, can_id=int(sent.can_id[0]))).values
    # Halves: a reading of a ten-thousandth is no whole step, and one beyond 16 bits is not clipped.
    assert [got[name][0] for name in ("X", "Y", "Z")] == [float(np.float16(1e-4)), -40_000.0, 3.25]


def _as_floats(sample: signals.FrameLayout) -> signals.FrameLayout:
    changed = (replace(s, is_float=True, signed=True, scale=1) if s.name in "XYZ" else s for s in sample.signals)
    return replace(sample, signals=tuple(changed))
