"""Somebody else at the bench: whatever he does to the device, and whenever, no PASS is written."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from station.domain.core.types import Outcome
from tests.conftest import SEED
from tests.fakes.intruder import ACTIONS, SERIAL, Deed, Intruder, send

RUNS = 6


@pytest.fixture(scope="module")
def calls(tmp_path_factory: pytest.TempPathFactory) -> int:
    """How many instants a run has before its verdict; nobody comes."""
    alone = Intruder(lambda _bench, _seat: None, 1 << 30)
    assert alone.run(tmp_path_factory.mktemp("alone")).results[SERIAL].outcome is Outcome.PASS
    return alone.calls


@pytest.mark.parametrize("number", range(RUNS))
@pytest.mark.parametrize("deed", ACTIONS)
def test_no_pass_whenever_he_comes(tmp_path: Path, calls: int, deed: str, number: int) -> None:
    rng = np.random.default_rng([SEED, number, list(ACTIONS).index(deed)])
    at = int((number + rng.random()) * calls / RUNS)
    intruder = Intruder(ACTIONS[deed], at)
    ran = intruder.run(tmp_path)
    assert intruder.came
    outcome, reasons = ran.results[SERIAL].outcome, ran.results[SERIAL].reasons
    assert outcome in (Outcome.ERROR, Outcome.FAIL), f"{deed} before call {at} of {calls}: {outcome}"
    assert reasons and ran.life(SERIAL)["outcome"] == str(outcome)
    if "writes" in deed:
        assert outcome is Outcome.ERROR, [r.sentence for r in reasons]


@pytest.mark.parametrize("deed", ACTIONS)
@pytest.mark.parametrize("before_last", [1, 2])
def test_the_last_instants_count_too(tmp_path: Path, calls: int, deed: str, before_last: int) -> None:
    ran = Intruder(ACTIONS[deed], calls - before_last).run(tmp_path)
    assert ran.results[SERIAL].outcome is Outcome.ERROR
    if deed == "writes a coefficient":
        assert "another master on the bus wrote to 0x2101:05" in ran.results[SERIAL].reasons[-1].sentence


@pytest.mark.parametrize(
    ("deed", "node_offset"),
    [
        (ACTIONS["writes a coefficient"], 40),
        (ACTIONS["resets the device"], 40),
        (lambda bench, seat: send(bench, 0x600 + seat.node, bytes.fromhex("4018100400000000")), 0),
        (lambda bench, seat: send(bench, 0x000, bytes([1, seat.node])), 0),
    ],
    ids=["write to another node", "reset of another node", "read", "start"],
)
def test_what_concerns_others_or_changes_nothing_is_no_fault(
    tmp_path: Path, calls: int, deed: Deed, node_offset: int
) -> None:
    elsewhere = Intruder(lambda bench, seat: deed(bench, replace(seat, node=seat.node + node_offset)), calls // 2)
    ran = elsewhere.run(tmp_path)
    assert elsewhere.came
    assert ran.results[SERIAL].outcome is Outcome.PASS, ran.results[SERIAL].reasons
