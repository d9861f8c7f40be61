"""Before a run, units that send by themselves are heard on a kernel's interface, and nothing is sent to anybody."""

import json
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from vcan_harness.interface import Interface
from vcan_harness.raw import RawSocket

from station.domain.can.encode import sample_frames, temperature_frames
from station.panel_protocol.companion import Companion, companion_file
from station.panel_protocol.nest_readings import read_readings
from station.panel_protocol.queue import LoadQueue, WaitingUnit
from station.wiring.jobs import load_job
from station.wiring.nest_listener import NestListener
from station.wiring.run_order import RunOrder

NODES = {"A": 0x11, "B": 0x12}


def test_units_that_send_by_themselves_are_heard_and_nothing_is_sent(
    vcan: Interface, raw_socket: Callable[..., RawSocket], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    bus = {"interface": "socketcan", "channel": vcan.name}
    nests = [{"name": name, "node": node} for name, node in NODES.items()]
    Path("config.yaml").write_text(json.dumps({"schema": "station.config/1", "bus": bus, "nests": nests}))
    database = tmp_path / "station.db"
    LoadQueue(companion_file(database, Companion.QUEUE)).put({n: WaitingUnit(f"SN000{i}") for i, n in enumerate(NODES)})
    listener = NestListener(RunOrder("six-point", database=database))
    unit, eavesdropper = raw_socket(vcan), raw_socket(vcan)
    listener.step()  # it opens its ears
    assert read_readings(database, time.time()) == {}
    layout = load_job("six-point")[0].layout
    xyz, times = np.array([[0.01, -0.02, 1.0], [0.03, -0.02, 1.0]]), np.arange(2, dtype=np.int64)
    frames = sample_frames(layout, NODES["B"], times, xyz)
    warmth = temperature_frames(layout, NODES["B"], times[:1], np.array([21.5]))
    sent = [(int(f.can_id[i]), bytes(f.data[i][: f.length[i]])) for f in (frames, warmth) for i in range(len(f))]
    for can_id, data in sent:
        unit.send(can_id, data)
    listener.step()
    found = read_readings(database, time.time())
    assert list(found) == ["B"]
    assert found["B"].serial == "SN0001"
    assert found["B"].vector == pytest.approx((0.02, -0.02, 1.0), abs=7e-5)
    assert found["B"].temperature_degC == pytest.approx(21.5)
    assert eavesdropper.waiting() == sent
    listener.close()
