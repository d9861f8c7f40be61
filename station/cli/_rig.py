"""The face of `station rig --simulate`: what a simulated machine tells, line by line."""

from station.cli._output import print_json
from station.cli._rig_drives import DRIVES
from station.errors import UsageError
from station.wiring.rig_machines import MACHINES, Machine


def simulate_machine(name: str, machine: Machine) -> int:
    """Runs the machine until its time is over or Ctrl-C, which is the way to stop it and no failure."""
    if name not in MACHINES:
        raise UsageError("rig-machine-unknown", name=name[:40], machines=[DRIVES, *MACHINES])
    try:
        MACHINES[name](machine, print_json)
    except KeyboardInterrupt:
        return 0
    return 0


__all__ = ["Machine", "simulate_machine"]
