"""The watch's parts against answers known beforehand, and its promise on false alarms against chance."""

import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from station.config.recipes import load_recipe
from station.domain.core.types import Floats
from station.domain.recipe.blocks import Limits
from station.domain.watch import change_point
from station.domain.watch import ranks as ranks_module
from station.domain.watch.bank import Alert, LoadValues, WatchBank, WatchedPlace
from station.domain.watch.e_detector import SHIFTS, WEIGHTS, ShiftDetector, likelihood_ratios
from station.domain.watch.load import load_values
from station.domain.watch.put_right import ReturnTest
from station.domain.watch.ranks import RankShares
from station.domain.watch.signals import WatchedSignal, projector
from station.domain.watch.size import drift_of
from tests.fakes.watched_log import visits

SEED = 11
Direction = tuple[int, int, int]


def test_a_nest_askew_is_the_rotation_that_it_was_turned_by() -> None:
    rng = np.random.default_rng(SEED)
    turn = np.array([1e-3, -2e-3, 0.5e-3])
    units = [visits(rng, turn) for _ in range(200)]
    made = projector(load_recipe("six-point"), units[0])
    assert made is not None
    found = np.mean([made.values(u)[WatchedSignal("nest-tilt")] for u in units], axis=0)
    # Antisymmetric part of matrices whose entries scatter by 3e-4, and noise of 1e-4 in two readings of each.
    std = math.sqrt((3e-4**2 + 1e-4**2 / 2) / 2 / 200)
    assert np.abs(found - turn).max() < 4.5 * std


def looks_uniform(shares: list[float]) -> None:
    """Mean and variance of independent uniform shares, and no correlation with the one before; 4.5 deviations."""
    centred = np.array(shares) - 0.5
    n = len(centred)
    assert abs(centred.mean()) < 4.5 * math.sqrt(1 / 12 / n)
    assert abs((centred**2).mean() - 1 / 12) < 4.5 * math.sqrt(1 / 180 / n)
    assert abs(np.mean(centred[1:] * centred[:-1])) < 4.5 / 12 / math.sqrt(n)


def test_ranks_of_any_distribution_are_uniform_and_independent() -> None:
    rng, ranks = np.random.default_rng(SEED), RankShares("a")
    looks_uniform([ranks.add(v) for v in rng.standard_cauchy(4000)])


def test_ranks_of_values_that_are_all_the_same_are_still_uniform() -> None:
    ranks = RankShares("b")
    looks_uniform([ranks.add(0.0) for _ in range(4000)])


def test_a_share_lies_within_its_rank_however_many_values_there_are() -> None:
    rng, ranks = np.random.default_rng(SEED), RankShares("c")
    values = rng.integers(0, 300, 1200).astype(float)
    for n, value in enumerate(values):
        before = values[:n]
        places = ranks.add(value) * (n + 1)
        assert (before < value).sum() <= places <= (before <= value).sum() + 1


@given(
    st.lists(st.sampled_from(range(40)), max_size=120),
    st.lists(st.sampled_from(range(40)), max_size=40),
    st.integers(0, 120),
)
def test_ranks_that_begin_anew_are_those_of_a_fresh_start(came: list[int], more: list[int], keep: int) -> None:
    """However much of what came is kept, and whatever else is put beside it."""
    values = np.array([*came[:keep], *more], float)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ranks_module, "_NEWEST", 5)
        ranks, fresh = RankShares("d"), RankShares("d")
        for value in came:
            ranks.add(value)
        ranks.restart(values)
        fresh.restart(values)
        assert len(ranks) == len(fresh) == len(values)
        assert sorted([*ranks._sorted, *ranks._newest]) == sorted(values)
        ranks._random.seed(1)
        fresh._random.seed(1)
        assert [ranks.add(v) for v in range(0, 40, 3)] == [fresh.add(v) for v in range(0, 40, 3)]


def test_a_ratio_is_that_of_students_density_and_one_on_average() -> None:
    unit = stats.t(8, scale=math.sqrt(6 / 8))
    shares = (np.arange(200_000) + 0.5) / 200_000
    values = unit.ppf(shares[::20_000])
    expected = unit.pdf(values[:, None] - SHIFTS) / unit.pdf(values)[:, None]
    assert likelihood_ratios(shares[::20_000].tolist()) == pytest.approx(expected, rel=1e-9)
    assert likelihood_ratios(shares.tolist()).mean(axis=0) == pytest.approx(1, abs=1e-3)


def test_the_evidence_follows_the_recursion_of_shiryaev_and_roberts() -> None:
    detector = ShiftDetector()
    ratios = likelihood_ratios([0.6, 0.1, 0.98])
    # Written out: the sum over beginnings of the product of the likelihood ratios since then.
    expected = sum(np.prod(ratios[k:], axis=0) for k in range(3))
    for row in ratios:
        detector.add(row)
    assert detector.evidence == pytest.approx(float(WEIGHTS @ expected), rel=1e-12)


def overshot(rng: np.random.Generator, shift: float, limit: float, trials: int) -> Floats:
    """Limit over evidence at an alarm, for values that are shifted after 100 quiet ones."""
    unit, found = stats.t(8, scale=math.sqrt(6 / 8)), list[float]()
    while len(found) < trials:
        detector = ShiftDetector()
        for row in likelihood_ratios(rng.random(100).tolist()):
            detector.add(row)
        if detector.evidence >= limit:
            continue
        while detector.evidence < limit:
            for row in likelihood_ratios(unit.cdf(unit.rvs(8, random_state=rng) + shift).tolist()):
                detector.add(row)
                if detector.evidence >= limit:
                    break
        found.append(limit / detector.evidence)
    return np.array(found)


def test_a_quiet_stream_alarms_less_often_than_once_in_as_many_loads_as_the_limit() -> None:
    """By a change of measure, which sees the run length of 3,300 loads in alarms that come after some ten."""
    rng, limit, trials = np.random.default_rng(SEED), 2000.0, 40
    parts = [overshot(rng, float(shift), limit, trials) for shift in SHIFTS]
    rate = sum(w * part.mean() for w, part in zip(WEIGHTS, parts, strict=True))
    std = math.sqrt(sum(w**2 * part.var(ddof=1) / trials for w, part in zip(WEIGHTS, parts, strict=True)))
    assert abs(rate - 0.61) < 4.5 * std
    assert rate + 4.5 * std < 1


def quiet_alarm(seed: int, loads: int, run_length: float) -> bool:
    """Whether a bank of 12 streams with heavy tails, that hang together, alarms within so many quiet loads."""
    rng = np.random.default_rng([SEED, seed])
    bank = WatchBank(12, run_length)
    for load in range(1, loads + 1):
        common = rng.standard_t(3)
        values = {WatchedPlace(WatchedSignal("offset"), n): common + rng.standard_t(3, 3) for n in "ABCD"}
        if bank.add(LoadValues(load, values))[0]:
            return True
    return False


def test_false_alarms_come_no_more_often_than_is_stated() -> None:
    runs, loads, run_length = 150, 60, 60.0
    alarms = sum(quiet_alarm(seed, loads, run_length) for seed in range(runs))
    bound = (loads - 30) / run_length  # the first 30 loads are learnt
    assert alarms / runs <= bound + 4.5 * math.sqrt(bound * (1 - bound) / runs)


def delay(seed: int, change: Floats) -> int:
    """Loads until a bank of 69 components finds a change (3) of one place."""
    rng, bank = np.random.default_rng([SEED, seed]), WatchBank(69)
    for load in range(1, 250):
        values = rng.normal(0, 1, 3) + (change if load > 150 else 0)
        if bank.add(load_values(load, {"A": {WatchedSignal("offset"): values}}, 1))[0] and load > 150:
            return load - 150
    return 100


def mean_delay(direction: Direction) -> float:
    """Loads until a change of two standard deviations in a direction is found, in 40 changes."""
    return float(np.mean([delay(seed, 2.0 * np.array(direction) / np.linalg.norm(direction)) for seed in range(40)]))


def test_a_change_of_all_components_is_found_nearly_as_soon_as_one_of_a_single_one() -> None:
    """1.11 ± .05 times as late in 120 changes; each stream by itself finds it 1.72 ± .08 times as late."""
    alone = mean_delay((1, 0, 0))
    assert mean_delay((1, 1, 1)) / alone < 1.4
    assert mean_delay((1, -1, 1)) / alone < 1.4


def test_a_change_of_two_components_is_one_alert() -> None:
    """Whichever stream sees it first: those that share a component with it say nothing new."""
    rng, bank, place = np.random.default_rng(SEED), WatchBank(), WatchedPlace(WatchedSignal("base-tilt"))
    raised = []
    for load in range(1, 401):
        drift = 0.05 * max(0, load - 200)
        raised += bank.add(LoadValues(load, {place: rng.normal([drift, 0], 1)}))[0]
    assert len(raised) == len(bank.open) == 1


def places_of_alerts(seed: int) -> list[list[WatchedPlace]]:
    """Offsets of four nests shift by up to one standard deviation with load 201, nest C is noisier by three with 231:
    places of the alerts of each."""
    rng, bank, raised = np.random.default_rng([SEED, seed]), WatchBank(), list[Alert]()
    offset, noise = WatchedSignal("offset"), WatchedSignal("noise")
    for load in range(1, 261):
        shift, noisy = np.array([1.0, -0.75, 0.5]) * (load > 200), 3.0 * (load > 230)
        units = {
            nest: {
                offset: rng.standard_t(4, 3) / math.sqrt(2) + shift,
                noise: rng.standard_t(4, 1) / math.sqrt(2) + noisy * (nest == "C"),
            }
            for nest in "ABCD"
        }
        raised += bank.add(load_values(load, units, 4))[0]
    return [[a.place for a in raised if (a.place.signal == noise) == of_noise] for of_noise in (False, True)]


def test_what_begins_with_an_open_alert_belongs_to_it_and_what_begins_later_does_not() -> None:
    """Components that change by half a standard deviation show it late, and their beginning wanders."""
    found = [places_of_alerts(seed) for seed in range(12)]
    assert all(noisy == [WatchedPlace(WatchedSignal("noise"), "C")] for _, noisy in found)
    assert all(shifted for shifted, _ in found)
    assert sum(len(shifted) for shifted, _ in found) <= 15, "20 where each alarm that is early or late is an alert"


def shifted(begin: int, n: int, size: float) -> Floats:
    x = np.random.default_rng([SEED, begin]).normal(0, 1, n)
    x[begin:] += size
    return x


@pytest.mark.parametrize("begin", [20, 300, 580])
def test_the_beginning_of_a_jump_is_found(begin: int) -> None:
    change = change_point.find(shifted(begin, 600, 5.0).tolist())
    assert change is not None
    assert abs(change.begin - begin) <= 2
    assert change.low <= change.begin <= change.high
    assert abs(change.after - change.before - 5.0) < 4.5 * change.size_std
    assert change.slope == 0


def test_the_span_of_the_beginning_holds_it_as_often_as_it_says() -> None:
    trials, begin, held = 200, 200, 0
    for seed in range(trials):
        values = np.random.default_rng([SEED, seed]).standard_t(5, begin + 30)
        values[begin:] += 2.0
        change = change_point.find(values.tolist())
        assert change is not None
        held += change.low <= begin <= change.high
    assert abs(held / trials - 0.95) < 4.5 * math.sqrt(0.95 * 0.05 / trials)


def test_a_drift_is_known_from_a_jump_and_meets_the_limit_when_it_does() -> None:
    signals = {WatchedSignal("offset"): np.zeros(3)}
    rng, bank = np.random.default_rng(SEED), WatchBank()
    for load in range(1, 241):
        drift = 0.001 * max(0, load - 200)
        value = {s: v + rng.normal(0, 0.002, 3) + [drift, 0, 0] for s, v in signals.items()}
        bank.add(load_values(load, {"A": value}, 1))
    (alert,) = bank.open
    bank.refresh(alert)
    found = drift_of(alert, Limits(offset=0.1))
    assert found is not None
    steepest = alert.changes[0]
    assert abs(found.per_load - 0.001) < 4.5 * steepest.slope_std + 0.0001  # the beginning is estimated, too
    assert found.loads_to_limit == pytest.approx(60, rel=0.15)


def test_one_wild_unit_raises_no_alarm() -> None:
    rng, bank = np.random.default_rng(SEED), WatchBank(3)
    raised = []
    for load in range(1, 101):
        value = rng.normal(0, 1, 3) + (1e6 if load == 60 else 0)
        raised += bank.add(load_values(load, {"A": {WatchedSignal("offset"): value}}, 1))[0]
    assert raised == []


def returns(values: Floats, after: Floats) -> list[int | None]:
    """What is known after each value of when the change was put right."""
    test, found = ReturnTest(after), list[int | None]()
    for value in values:
        test.extend(value[None])
        found.append(test.righted_since())
    return found


def test_a_change_that_lasts_is_not_taken_for_put_right_and_one_that_is_over_soon_is() -> None:
    """Found where chance made it large: its first ten values lie 0.8 standard deviations above its level of 1.5."""
    trials, lasting, repaired, back, wrong, late = 60, 60, 40, 1.5, 0, 0
    for seed in range(trials):
        values = math.sqrt(3 / 5) * np.random.default_rng([SEED, seed]).standard_t(5, (lasting + repaired, 2))
        values[:lasting, 0] += back
        values[:10, 0] += 0.8
        after = values[:10].mean(axis=0)
        since = returns(values, after)
        wrong += any(found is not None for found in since[10:lasting])
        found = next((s for s in since[lasting:-1] if s), None)
        late += found is None or not lasting - 15 <= found <= lasting + 15
    assert wrong / trials <= 0.02 + 4.5 * math.sqrt(0.02 / trials), "one in fifty, and chance"
    assert late / trials <= 0.02 + 4.5 * math.sqrt(0.02 / trials)


def test_values_that_come_at_once_say_the_same_as_one_after_the_other() -> None:
    values = np.random.default_rng(SEED).normal(1.0, 1.0, (90, 2))
    values[50:] -= 1.0
    at_once, one_by_one = ReturnTest(np.ones(2)), ReturnTest(np.ones(2))
    at_once.extend(values)
    for value in values:
        one_by_one.extend(value[None])
    assert at_once.righted_since() == one_by_one.righted_since()
    assert len(at_once) == len(one_by_one) == 90


def test_one_good_unit_after_a_large_change_does_not_end_it() -> None:
    values = np.full((12, 1), 50.0)
    values[11] = 0.0
    assert returns(np.vstack([values, [[0.0]]]), np.array([50.0]))[-2:] == [None, 11]


def test_a_load_costs_the_same_however_long_an_alert_has_been_open() -> None:
    rng, bank, place = np.random.default_rng(SEED), WatchBank(), WatchedPlace(WatchedSignal("noise"), "A")

    def go(loads: range) -> None:
        for number in loads:
            bank.add(LoadValues(number, {place: rng.normal(3.0 * (number > 100), 1, 1)}))

    def most_memory(loads: range) -> int:
        tracemalloc.start()
        go(loads)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    go(range(1, 2500))
    assert len(bank.open) == 1
    early = most_memory(range(2500, 2520))
    go(range(2520, 6000))
    assert most_memory(range(6000, 6020)) <= 1.05 * early
    assert len(bank.open) == 1


def test_an_open_alert_is_estimated_anew_when_a_hundredth_more_loads_came() -> None:
    rng, bank, place = np.random.default_rng(SEED), WatchBank(), WatchedPlace(WatchedSignal("noise"), "A")
    seen = []
    for number in range(1, 701):
        bank.add(LoadValues(number, {place: rng.normal(3.0 * (number > 100), 1, 1)}))
        for alert in bank.open:
            bank.refresh(alert)
            seen.append(alert.loads)
    assert abs(alert.begin - 101) <= 1
    # Each of the first hundred loads, then every second, … every sixth.
    assert seen[:90] == list(range(seen[0], seen[0] + 90))
    assert len(set(seen)) < 310
    assert seen[-1] >= 695


def test_other_places_keep_what_they_learnt_when_a_change_is_put_right() -> None:
    rng, bank, ended = np.random.default_rng(SEED), WatchBank(), 0
    places = [WatchedPlace(WatchedSignal("offset"), nest) for nest in "AB"]
    for number in range(1, 161):
        shift = 6.0 if 80 < number <= 120 else 0.0
        ended += len(bank.add(LoadValues(number, {p: rng.normal(shift * (p == places[0]), 1, 2) for p in places}))[1])
    assert ended == 1
    assert [len(bank._streams[p][0]) for p in places] == [pytest.approx(120, abs=6), 160]
