"""The next run of ties that a diagnosis may end in."""

import pytest

from station.diagnosis.candidates.bank import FLOOR_CAUSES, cause_library
from station.diagnosis.linear.noise_floor import NoiseFloor
from station.diagnosis.planning.proposal import CauseHypothesis, CauseTie, MeasuredCampaign, propose
from station.wiring.jobs import load_job


@pytest.mark.parametrize("variance", FLOOR_CAUSES)
def test_a_tie_with_a_variance_of_the_floor_is_no_pair_to_part(variance: str) -> None:
    """A slow cause and a bias that walks can look alike; a variance has no shape that a run could be planned for."""
    recipe = load_job("six-point")[0].recipe
    effect = next(e for e in cause_library(recipe) if e.id == "offset-temperature")
    found = CauseHypothesis(effect, "unit", 1e-3)
    campaign = MeasuredCampaign(recipe, units=2, nests=2, floor=NoiseFloor(1e-4, 0.0, 0.0))
    proposal = propose(campaign, [CauseTie(found, (variance,))])
    assert proposal is None
