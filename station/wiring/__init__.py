"""Settings → a station: the only place that picks adapters."""

from station.wiring.bench import Bench, open_bench
from station.wiring.jobs import load_job
from station.wiring.run_order import RunOrder

__all__ = ["Bench", "RunOrder", "load_job", "open_bench"]
