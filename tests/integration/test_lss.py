"""LSS on one bus: fresh devices addressed, scans and selections in time, masters killed, slaves that answer wrongly."""

import json
import queue
import random
import threading
from pathlib import Path
from typing import Any, cast

import pytest
from canopen.lss import LssMaster as IndependentMaster

from station.adapters.bus.python_can import PythonCan
from station.adapters.clock import SystemClock
from station.adapters.simulated_device.live import Hub, serve
from station.adapters.simulated_device.lss import LssSlave
from station.adapters.simulated_device.nonvolatile import NonVolatileMemory
from station.cli.app import run_command
from station.errors import BusFault, DeviceSilent, UnitFault, UsageError
from station.messages import render
from station.ports.bus import Endpoint
from station.ports.lss import UNCONFIGURED, LssIdentity
from station.service.commission import assign_nodes, store_bit_rate
from station.wiring.commission import commissioning_bench, fresh_device, product_identity
from station.wiring.jobs import load_job
from tests.fakes import plant_device as plant
from tests.fakes.lss_fleet import (
    PRODUCT,
    WIRE_S,
    Fleet,
    Member,
    killed_and_repeated,
    mistakes,
    product,
    random_fleet,
    seats_of,
)

NODES = tuple(range(0x11, 0x21))


def identity(serial: int) -> LssIdentity:
    return LssIdentity(PRODUCT.vendor, PRODUCT.product, PRODUCT.revision, serial)


@pytest.mark.parametrize(
    ("count", "factory"), [(16, NODES[3]), (4, UNCONFIGURED), (4, 1)], ids=["a nest's", "none", "default"]
)
def test_fresh_devices_that_share_an_id_or_have_none_get_those_of_their_labels(count: int, factory: int) -> None:
    labels = [identity(1000 + i) for i in range(count)]
    fleet = Fleet([Member(i, factory=factory) for i in reversed(labels)])
    seats = seats_of(NODES[:count], labels)
    assert mistakes(fleet, seats, fleet.commission(seats)) == []


@pytest.mark.parametrize("left_out", ["eds", "identity"])
def test_the_product_file_says_whom_to_select_and_else_the_eds(tmp_path: Path, left_out: str) -> None:
    job, source = load_job(plant.recipe(tmp_path, product={left_out: None}))
    assert product_identity(job, source) == LssIdentity(0x000CA1B0, 0x00000ACC, 0x00010000, 0)


def test_sixteen_fresh_devices_without_labels_are_found_by_scans() -> None:
    fleet = Fleet([Member(identity(0xA5A50000 + 977 * i)) for i in range(16)])
    seats = seats_of(NODES, [None] * 16)
    assert mistakes(fleet, seats, fleet.commission(seats)) == []


def test_a_second_commissioning_changes_nothing() -> None:
    fleet = Fleet([Member(identity(i)) for i in (7, 8, 9)])
    seats = seats_of(NODES[:3], [identity(9), None, None])
    fleet.commission(seats)
    before = {d.slave.identity: d.slave.node for d in fleet.devices}
    again = fleet.commission(seats)
    assert again is not None
    assert {d.how for d in again.devices} == {"stays"}
    assert {d.slave.identity: d.slave.node for d in fleet.devices} == before


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_scan_of_a_random_identity_takes_less_than_4_s(seed: int) -> None:
    rng = random.Random(seed)
    members = [Member(LssIdentity(*(rng.getrandbits(32) for _ in range(4)))) for _ in range(16)]
    fleet = Fleet(members)
    master = fleet.bench(NODES).lss
    start_s = fleet.clock.monotonic_s()
    found = master.scan()
    took_s = fleet.clock.monotonic_s() - start_s + 2 * WIRE_S * fleet.channel.sent
    assert found in [m.identity for m in members]
    assert took_s <= 4.0
    assert master.node_id() == UNCONFIGURED


def test_selecting_and_addressing_takes_less_than_50_ms_each() -> None:
    fleet = Fleet([Member(identity(i)) for i in range(16)])
    master = fleet.bench(NODES).lss
    for i, node in enumerate(NODES):
        start_s, sent = fleet.clock.monotonic_s(), fleet.channel.sent
        assert master.select(identity(i))
        master.configure_node(node)
        master.store()
        master.release()
        took_s = fleet.clock.monotonic_s() - start_s + 2 * WIRE_S * (fleet.channel.sent - sent)
        assert took_s <= 0.050
    fleet.clock.sleep(0.3)
    assert sorted(fleet.node_ids()) == list(NODES)


@pytest.mark.parametrize("seed", range(5))
def test_a_random_fleet_is_addressed_without_a_mistake(seed: int) -> None:
    members, seats = random_fleet(random.Random(seed), most=6)
    fleet = Fleet(members)
    assert mistakes(fleet, seats, fleet.commission(seats)) == []


def test_a_master_killed_at_any_frame_leaves_no_two_devices_with_one_id() -> None:
    members = [Member(identity(5), stored=NODES[1]), Member(identity(6), stored=NODES[0]), Member(identity(7))]
    seats = seats_of(NODES[:3], [identity(5), identity(6), None])
    whole = Fleet(members)
    whole.commission(seats)
    frames = [*range(0, 60, 5), *range(61, whole.frames, 13)]
    assert whole.frames > 61
    assert {frame: wrong for frame in frames if (wrong := killed_and_repeated(members, seats, frame))} == {}


@pytest.mark.parametrize("labelled", [True, False])
def test_a_slave_that_selects_itself_early_is_reported_and_gets_nothing(labelled: bool) -> None:
    fleet = Fleet([Member(identity(5), fault="lss-early")])
    with pytest.raises(UnitFault, match="answered as selected before its serial was sent"):
        fleet.commission(seats_of(NODES[:1], [identity(5) if labelled else None]))
    assert fleet.node_ids() == []


@pytest.mark.parametrize("labelled", [True, False])
def test_a_slave_that_answers_twice_is_reported_and_gets_nothing(labelled: bool) -> None:
    fleet = Fleet([Member(identity(5), fault="lss-twice")])
    with pytest.raises(BusFault, match=r"One LSS command .* got two answers"):
        fleet.commission(seats_of(NODES[:1], [identity(5) if labelled else None]))
    assert fleet.node_ids() == []


def test_two_devices_of_one_identity_are_reported() -> None:
    fleet = Fleet([Member(identity(5)), Member(identity(5))])
    with pytest.raises(BusFault, match="got two answers"):
        fleet.commission(seats_of(NODES[:2], [identity(5), None]))
    assert fleet.node_ids() == []


def test_a_label_that_nobody_bears_changes_nothing() -> None:
    fleet = Fleet([Member(identity(5), stored=3)])
    with pytest.raises(DeviceSilent, match="No device answered to serial 6"):
        fleet.commission(seats_of(NODES[:2], [identity(5), identity(6)]))
    assert fleet.node_ids() == [3]


def test_an_empty_nest_and_a_device_too_many_are_said() -> None:
    few, many = Fleet([Member(identity(5))]), Fleet([Member(identity(5)), Member(identity(6))])
    found = few.commission(seats_of(NODES[:2], [None, None]))
    assert found is not None
    assert [m.id for m in found.findings] == ["commission-nest-empty"]
    found = many.commission(seats_of(NODES[:1], [identity(5)]))
    assert found is not None
    assert [(m.id, m.parameters) for m in found.findings] == [("commission-left-over", {"serial": 6})]


def test_the_bit_rate_is_configured_stored_and_refused_outside_the_table() -> None:
    fleet = Fleet([Member(identity(5))])
    master = fleet.bench(NODES).lss
    assert master.select(identity(5))
    master.configure_bit_rate(125)
    master.store()
    fleet.power_cycle()
    assert fleet.devices[0].slave.bit_timing == 4
    with pytest.raises(UsageError, match="42 kbit/s is not in the table"):
        master.configure_bit_rate(42)


@pytest.mark.parametrize(
    ("command", "error", "said"),
    [
        (0x11, 1, "refused to take a node id by LSS: the value is not among those it takes (error 1, detail 9)"),
        (0x17, 1, "refused to store its settings by LSS: it cannot store them (error 1, detail 9)"),
        (0x17, 2, "refused to store its settings by LSS: its memory failed (error 2, detail 9)"),
        (0x13, 255, "refused to take a bit rate by LSS: for a reason of its maker (error 255, detail 9)"),
    ],
)
def test_a_refusal_names_the_unit_and_what_the_error_means(
    monkeypatch: pytest.MonkeyPatch, command: int, error: int, said: str
) -> None:
    """CiA 305: 1 is out of range or unable to store, 2 a failed memory, 255 the maker's."""
    take = LssSlave.take

    def refusing(slave: LssSlave, data: bytes) -> Any:
        return (bytes([command, error, 9, 0, 0, 0, 0, 0]),) if data[0] == command else take(slave, data)

    monkeypatch.setattr(LssSlave, "take", refusing)
    master = Fleet([Member(identity(5))]).bench(NODES).lss
    assert master.select(identity(5))
    with pytest.raises(UnitFault) as refused:
        master.configure_node(17)
        master.store()
        master.configure_bit_rate(125)
    assert f"Serial 5 {said}" in render(refused.value.message)


def test_devices_on_a_real_multicast_bus_are_addressed_in_real_time() -> None:
    """Real sockets, the devices in a thread of their own; half of them by label."""
    clock, settings = SystemClock(), PythonCan.Settings(driver="udp_multicast", options={"port": 43_305})
    near, far = (PythonCan.open("239.74.163.5", clock, settings) for _ in range(2))
    hub = Hub(cast(Endpoint, far.service(())))
    slaves = [LssSlave(identity(serial), NonVolatileMemory()) for serial in (0x5555, 0x5556, 7, 8)]
    devices = [fresh_device(lambda _ids: hub.endpoint(), clock, *product(), slave) for slave in slaves]
    ended = threading.Event()
    served = threading.Thread(target=serve, args=(hub, devices, clock, lambda: not ended.is_set()))
    served.start()
    try:
        seats = seats_of(NODES[:4], [identity(8), None, identity(7), None])
        found = assign_nodes(commissioning_bench(near, clock, NODES[:4], 5.0), seats, PRODUCT)
    finally:
        ended.set()
        served.join(5.0)
        near.close()
        far.close()
    assert [(d.node, d.how) for d in found.devices] == list(
        zip(NODES[:4], ("label", "scan", "label", "scan"), strict=True)
    )
    assert {d.node: d.identity for d in found.devices} == {s.node: s.identity for s in slaves}


class _Wire:
    """Between the canopen library's master and one slave of ours."""

    def __init__(self, slave: LssSlave, master: Any) -> None:
        self._slave, self._master = slave, master

    def send_message(self, _can_id: int, data: bytearray) -> None:
        for answer in self._slave.take(bytes(data)):
            self._master.on_message_received(0x7E4, bytearray(answer), 0.0)


def test_the_slave_obeys_an_independent_master() -> None:
    slave = LssSlave(LssIdentity(0xDEADBEEF, 1, 0x80000000, 0xFFFFFFFF), NonVolatileMemory())
    master: Any = IndependentMaster()
    master.RESPONSE_TIMEOUT = 0.001
    master.network = _Wire(slave, master)
    assert isinstance(master.responses, queue.Queue)
    assert master.fast_scan() == (True, list(slave.identity.numbers))
    master.configure_node_id(0x21)
    master.store_configuration()
    slave.power_on()
    assert master.send_switch_state_selective(*slave.identity.numbers)
    assert master.inquire_node_id() == 0x21


def test_the_command_addresses_a_fixture_and_finds_it_addressed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["commission", "--simulate", "--json", "--serial", "SN0042", "--nest", "B", "--device-state", str(tmp_path)]
    hows = []
    for _ in range(2):
        assert run_command(line) == 0
        document = json.loads(capsys.readouterr().out)
        assert document["schema"] == "station.commission/1"
        assert [(d["nest"], d["node"]) for d in document["devices"]] == [("A", 17), ("B", 18), ("C", 19), ("D", 20)]
        assert document["devices"][1]["serial"] == 42
        hows.append([d["how"] for d in document["devices"]])
    assert hows == [["scan", "label", "scan", "scan"], ["stays"] * 4]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--serial", "SN1"], "1 serials and 0 nests"),
        (["--serial", "SN1", "--nest", "Z"], "There is no nest Z; config.yaml has A, B, C, D"),
        (["--serial", f"SN{1 << 32}", "--nest", "A"], "is a larger number than the 32 bits of 0x1018:4 hold"),
        (["--serial", "SN1", "--nest", "A", "--serial", "SN2", "--nest", "A"], "--nest was given the same value twice"),
        (["--serial", "none", "--nest", "A"], "none"),
    ],
)
def test_a_wrong_command_line_gets_a_sentence(words: list[str], sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        run_command(["commission", "--simulate", *words])


def test_a_bit_rate_is_kept_by_every_device_and_nobody_is_lost_before_the_power_goes() -> None:
    fleet = Fleet([Member(identity(i)) for i in (7, 8, 9)])
    seats = seats_of(NODES[:3], [identity(i) for i in (7, 8, 9)])
    found = fleet.commission(seats)
    assert found is not None
    said: list[str] = []
    store_bit_rate(fleet.bench(NODES[:3]), found.devices, 250, lambda message: said.append(render(message)))
    assert [d.slave.bit_timing for d in fleet.devices] == [3, 3, 3]
    assert said == [
        "3 devices keep 250 kbit/s from the next power-on: set bus.bitrate of config.yaml, then switch "
        "the fixture off and on."
    ]
    assert mistakes(fleet, seats, fleet.commission(seats)) == []


def test_a_bit_rate_that_lss_does_not_know_is_refused() -> None:
    fleet = Fleet([Member(identity(7))])
    found = fleet.commission(seats_of(NODES[:1], [identity(7)]))
    assert found is not None
    with pytest.raises(UsageError, match="300"):
        store_bit_rate(fleet.bench(NODES[:1]), found.devices, 300)
