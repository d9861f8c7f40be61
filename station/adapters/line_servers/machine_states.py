"""PackML's three nested state machines: which is in what state."""

from station.adapters.line_servers import companion_types as types
from station.domain.cell.packml import State

#: The machines, outer one first, by their way from the PackML object.
MACHINES = (
    (("BaseStateMachine",), types.BASE_MACHINE),
    (("BaseStateMachine", "MachineState"), types.MACHINE_MACHINE),
    (("BaseStateMachine", "MachineState", "ExecuteState"), types.EXECUTE_MACHINE),
)


def machine_states(state: State | None) -> tuple[str, str, str]:
    """The states of the three, outer one first; '' where a machine is not in use."""
    if state is None:
        return "", "", ""
    name = state.label.capitalize()
    if name in types.BASE_MACHINE.states:
        return name, "", ""
    if name in types.MACHINE_MACHINE.states:
        return "Cleared", name, ""
    return "Cleared", "Running", name
