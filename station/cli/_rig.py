"""The face of `station rig --simulate`: what a simulated machine tells, line by line."""

from station.cli._output import print_json
from station.errors import UsageError
from station.wiring.rig_machines import MACHINES, CellOptions, Machine


def simulate_machine(action: str, name: str | None, machine: Machine) -> int:
    """Runs the machine until its time is over or Ctrl-C, which is the way to stop it and no failure."""
    if action or name is None:
        raise UsageError("rig-action", action=action)
    if name not in MACHINES:
        raise UsageError("rig-machine-unknown", name=name[:40], machines=list(MACHINES))
    try:
        MACHINES[name](machine, print_json)
    except KeyboardInterrupt:
        return 0
    return 0


__all__ = ["CellOptions", "Machine", "simulate_machine"]
