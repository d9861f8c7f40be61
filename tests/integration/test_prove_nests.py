"""`station commission --prove-nests`: the nest of each unlabelled unit, with people who make mistakes."""

import json
import random
from collections.abc import Mapping, Sequence
from io import StringIO
from pathlib import Path

import pytest

from station.adapters.simulated_device.lss import LssDevice
from station.cli._confirm import wait_for_person
from station.cli.app import run_command
from station.errors import UsageError, WrongUnit
from station.messages import Message
from station.ports.lss import LssIdentity
from station.service.commission import Commissioned
from station.service.prove_nests import assign_proven_nodes
from tests.fakes.lss_fleet import PRODUCT, Fleet, MasterKilled, Member, mistakes, seats_of

NODES = (0x11, 0x12, 0x13, 0x14)


def identity(serial: int) -> LssIdentity:
    return LssIdentity(PRODUCT.vendor, PRODUCT.product, PRODUCT.revision, serial)


class Person:
    """Does what is asked; at first, and `errs` times in all, something else: the units of `wrong` are taken out."""

    def __init__(self, fleet: Fleet, fitted: Mapping[str, LssDevice], wrong: Sequence[str] = (), errs: int = 0) -> None:
        self._fleet, self._fitted, self._wrong, self._errs = fleet, fitted, wrong, errs
        self._out: list[LssDevice] = []
        self.actions: list[str] = []

    def __call__(self, action: Message) -> None:
        self.actions.append(action.id)
        for device in self._out:
            device.power_cycle()
            self._fleet.clock.attach(device)
        nests: Sequence[str] = ()
        if action.id == "commission-take-out":
            nests = self._wrong if self._errs > 0 else (str(action.parameters["nest"]),)
            self._errs -= 1
        self._out = [self._fitted[nest] for nest in nests]
        for device in self._out:
            self._fleet.clock.detach(device)


class Bench:
    """Fresh units in four nests, `labels` of them scanned, and a person; unit serial 5 + i sits in nest order[i]."""

    def __init__(
        self, order: Sequence[int], labelled: Sequence[int] = (), wrong: Sequence[int] = (), errs: int = 0
    ) -> None:
        self.fleet = Fleet([Member(identity(5 + i)) for i in range(len(order))])
        fitted = {f"N{NODES[place]}": self.fleet.devices[i] for i, place in enumerate(order)}
        self.truth = {nest: device.slave.identity for nest, device in fitted.items()}
        nodes = NODES[: len(order)]
        self.seats = seats_of(nodes, [self.truth[f"N{n}"] if n in labelled else None for n in nodes])
        self.person = Person(self.fleet, fitted, [f"N{n}" for n in wrong], errs)
        self.heard: list[Message] = []

    def commission(self, killed_at: int | None = None) -> Commissioned | None:
        """None: the master was killed."""
        bench = self.fleet.bench(NODES, killed_at)
        try:
            return assign_proven_nodes(bench, self.seats, PRODUCT, self.heard.append, self.person)
        except MasterKilled:
            return None
        finally:
            self.fleet.frames = self.fleet.channel.sent
            self.fleet.channel.close()

    def mistakes(self, found: Commissioned | None) -> list[str]:
        """Those of any commissioning, and every unit that has another nest's id."""
        assert found is not None
        wrong = [str(d) for d in found.devices if self.truth[d.nest] != d.identity]
        return wrong + mistakes(self.fleet, self.seats, found)


@pytest.mark.parametrize("seed", range(4))
def test_every_unit_gets_the_id_of_the_nest_it_sits_in(seed: int) -> None:
    order = random.Random(seed).sample(range(4), 4)
    bench = Bench(order, labelled=NODES[:seed])
    found = bench.commission()
    assert found is not None
    assert bench.mistakes(found) == []
    assert found.findings == ()
    hows = [d.how for d in found.devices[seed:]]
    assert hows == (["proven"] * (4 - seed) if seed < 3 else ["scan"])
    assert bench.person.actions.count("commission-take-out") == 3 - seed


def test_a_second_proof_changes_nothing() -> None:
    bench = Bench([2, 0, 1])
    bench.commission()
    before = [d.slave.node for d in bench.fleet.devices]
    assert bench.mistakes(bench.commission()) == []
    assert [d.slave.node for d in bench.fleet.devices] == before


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [((), "commission-none-silent"), (NODES[:2], "commission-others-silent"), (NODES[:3], "commission-others-silent")],
)
def test_a_person_who_errs_is_asked_again(wrong: Sequence[int], sentence: str) -> None:
    bench = Bench([1, 2, 0], wrong=wrong, errs=2)
    found = bench.commission()
    assert bench.mistakes(found) == []
    assert [m.id for m in bench.heard].count(sentence) == 2


def test_a_nest_that_stays_unclear_changes_nothing() -> None:
    bench = Bench([1, 2, 0], wrong=(), errs=9)
    with pytest.raises(WrongUnit, match="3 times the bus did not show"):
        bench.commission()
    assert sorted(bench.fleet.node_ids()) == list(NODES[:3])


def test_the_unit_of_an_earlier_nest_is_not_taken_for_that_of_the_next() -> None:
    bench = Bench([1, 2, 0], labelled=NODES[:1], wrong=NODES[:1], errs=1)
    assert bench.mistakes(bench.commission()) == []
    assert [m.parameters["serials"] for m in bench.heard if m.id == "commission-others-silent"] == [(7,)]


def test_an_empty_nest_is_reported_before_anybody_takes_a_unit_out() -> None:
    bench = Bench([1, 0])
    bench.seats = seats_of(NODES[:3], [None] * 3)
    found = bench.commission()
    assert found is not None
    assert [m.id for m in found.findings] == ["commission-nest-empty", "commission-nest-unproven"]
    assert bench.person.actions == ["commission-fill-all"]


def test_a_proof_killed_at_any_frame_goes_on_with_the_same_command() -> None:
    whole = Bench([1, 2, 0])
    whole.commission()
    assert whole.fleet.frames > 100
    for frame in range(3, whole.fleet.frames, 37):
        bench = Bench([1, 2, 0])
        assert bench.commission(killed_at=frame) is None
        bench.fleet.clock.sleep(1.0)
        ids = bench.fleet.node_ids()
        assert len(ids) == len(set(ids)), f"killed at frame {frame}"
        assert bench.mistakes(bench.commission()) == [], f"killed at frame {frame}"
        bench.fleet.close()


def test_the_command_proves_nests_on_simulated_units(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = ["commission", "--simulate", "--json", "--prove-nests", "--serial", "SN0042", "--nest", "B"]
    for how in ("label", "stays"):
        assert run_command([*line, "--device-state", str(tmp_path)]) == 0
        document = json.loads(capsys.readouterr().out)
        assert [(d["nest"], d["node"], d["serial"], d["how"]) for d in document["devices"]] == [
            ("A", 17, 3, "proven"),
            ("B", 18, 42, how),
            ("C", 19, 2, "proven"),
            ("D", 20, 1, "proven"),
        ]
        assert document["findings"] == []


def test_nests_are_not_proven_where_nobody_is_at_the_terminal(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench = Bench([0, 1])
    monkeypatch.setattr("sys.stdin", StringIO())
    with pytest.raises(UsageError, match="the command has no terminal"):
        assign_proven_nodes(bench.fleet.bench(NODES), bench.seats, PRODUCT, bench.heard.append, wait_for_person)
    assert bench.fleet.channel.sent == 0
