"""What was measured, as a plan of the next run sees it."""

from station.diagnosis.planning.bench import bench_of
from station.diagnosis.planning.proposal import MeasuredCampaign
from station.diagnosis.results.diagnose import Diagnosis

#: Units that a plan needs at most to know what more units would show.
MAX_PLANNED_UNITS = 6


def measured_campaign(d: Diagnosis) -> MeasuredCampaign:
    """What was measured, as a plan sees it."""
    visits = d.last.view.scene.visits
    nests = len(visits.group("nest", 1)[1]) if "nest" in visits.groups else 1
    units = min(len(d.samples.units), MAX_PLANNED_UNITS)
    return MeasuredCampaign(d.recipe, units, nests, d.floor.floor, bench_of(d.last.view.scene))
