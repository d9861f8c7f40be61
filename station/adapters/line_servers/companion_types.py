"""Types of OPC 30050 (PackML), OPC 40001-1 (Machinery) and OPC 10000-100 (DI) that the line's server shows, as tables.

Names, numeric node ids, data types and numbers are the specifications'; what the station does not use is left out.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from station.adapters.line_servers.companion_structures import ALARM, COUNT, DESCRIPTOR, PRODUCT, StructureType

PACKML = "http://opcfoundation.org/UA/PackML/"
MACHINERY = "http://opcfoundation.org/UA/Machinery/"
DI = "http://opcfoundation.org/UA/DI/"
#: Types of the base namespace.
BASE_OBJECT, FOLDER, FINITE_STATE_MACHINE, ANALOG_ITEM, DATA_VARIABLE = 58, 61, 2771, 2368, 63
#: Well-known nodes: the folder of PackML objects; the folder of machines; the only mode of the station.
PACKML_OBJECTS, MACHINES, MODE_ENUM, PRODUCE = 72, 1001, 11, 1
PACKML_VERSION = "TR88.00.02-2015"

#: References of PackML, each a kind of HasComponent, by name.
REFERENCES = {"HasAlarm": 22, "HasAlarmHistory": 23, "HasStopReason": 25}

NodeOf = tuple[str, int]
"""A type by namespace ('' is the base one) and number."""


@dataclass(frozen=True, slots=True)
class TypeMember:
    """data_type: number in the base namespace, or a structure of PackML; kind: its type there, 0 for a property;
    dimensions: of an array of them; base_name: its name is of the base namespace; reference: what hangs it to its type,
    of REFERENCES, '' for a plain component."""

    node: int
    name: str
    data_type: int | StructureType
    kind: int = DATA_VARIABLE
    optional: bool = False
    namespace: str = ""
    dimensions: int = 0
    base_name: bool = False
    reference: str = ""


@dataclass(frozen=True, slots=True)
class MethodType:
    """argument: name, data type as of TypeMember, and whether it is a list of them; node: that of its arguments."""

    node: int
    arguments_node: int = 0
    argument: tuple[str, int | StructureType, bool] | None = None
    mandatory: bool = False


@dataclass(frozen=True, slots=True)
class Part:
    """An object in a type; of: its own type; substate_of: the state whose states are its own."""

    node: int
    name: str
    of: NodeOf
    substate_of: str = ""


@dataclass(frozen=True, slots=True)
class CompanionType:
    """An object type. states, transitions: node, number and the node that holds the number, by name; methods: by name;
    causes: method of each transition that has one."""

    namespace: str
    node: int
    name: str
    base: NodeOf = ("", BASE_OBJECT)
    variables: tuple[TypeMember, ...] = ()
    parts: tuple[Part, ...] = ()
    states: Mapping[str, tuple[int, int, int]] = field(default_factory=dict)
    transitions: Mapping[str, tuple[int, int, int]] = field(default_factory=dict)
    methods: Mapping[str, MethodType] = field(default_factory=dict)
    causes: Mapping[str, str] = field(default_factory=dict)


_BOOLEAN, _INT32, _FLOAT, _STRING, _NODE_ID, _TEXT, _ENUMERATION = 1, 6, 10, 12, 17, 21, 29


def _numbered(nodes: Mapping[str, tuple[int, int]]) -> dict[str, tuple[int, int, int]]:
    """Transitions that the specification does not number are numbered on."""
    return {name: (node, number, held) for number, (name, (node, held)) in enumerate(nodes.items(), 1)}


def _present(states: int, transitions: int) -> tuple[TypeMember, ...]:
    """The lists of states and transitions that a machine has."""
    return (
        TypeMember(states, "AvailableStates", _NODE_ID, dimensions=1, base_name=True),
        TypeMember(transitions, "AvailableTransitions", _NODE_ID, dimensions=1, base_name=True),
    )


EXECUTE_MACHINE = CompanionType(
    PACKML, 1, "PackMLExecuteStateMachineType", ("", FINITE_STATE_MACHINE),
    states={
        "Starting": (29, 3, 129), "Idle": (28, 4, 128), "Suspended": (31, 5, 131), "Execute": (36, 6, 136),
        "Holding": (33, 10, 133), "Held": (34, 11, 134), "Unholding": (35, 12, 135), "Suspending": (30, 13, 130),
        "Unsuspending": (32, 14, 132), "Resetting": (27, 15, 127), "Completing": (37, 16, 137),
        "Complete": (38, 17, 138),
    },
    transitions=_numbered({
        "ResettingToIdle": (39, 139), "IdleToStarting": (40, 140), "StartingToExecute": (41, 141),
        "ExecuteToSuspending": (42, 142), "SuspendingToSuspended": (43, 143), "UnsuspendingToExecute": (44, 144),
        "ExecuteToHolding": (45, 145), "HoldingToHeld": (46, 146), "HeldToUnholding": (47, 147),
        "UnholdingToExecute": (48, 148), "ExecuteToCompleting": (49, 149), "CompletingToComplete": (50, 150),
        "CompleteToResetting": (51, 151), "SuspendedToUnsuspending": (52, 152), "StartingToHolding": (99, 179),
        "UnsuspendingToHolding": (100, 208), "SuspendedToHolding": (101, 215), "SuspendingToHolding": (102, 216),
        "UnholdingToHolding": (103, 217),
    }),
    variables=_present(125, 126),
    methods={
        "Reset": MethodType(361), "ToComplete": MethodType(365), "Hold": MethodType(366), "Suspend": MethodType(367),
        "Unhold": MethodType(368), "Start": MethodType(369, 342, ("Parameter", DESCRIPTOR, True)),
        "Unsuspend": MethodType(372),
    },
    causes={
        "IdleToStarting": "Start", "ExecuteToSuspending": "Suspend", "ExecuteToHolding": "Hold",
        "HeldToUnholding": "Unhold", "ExecuteToCompleting": "ToComplete", "CompleteToResetting": "Reset",
        "SuspendedToUnsuspending": "Unsuspend", "StartingToHolding": "Hold", "UnsuspendingToHolding": "Hold",
        "SuspendedToHolding": "Hold", "SuspendingToHolding": "Hold", "UnholdingToHolding": "Hold",
    },
)  # fmt: skip
MACHINE_MACHINE = CompanionType(
    PACKML, 2, "PackMLMachineStateMachineType", ("", FINITE_STATE_MACHINE),
    states={
        "Clearing": (55, 1, 157), "Stopped": (53, 2, 155), "Stopping": (54, 7, 156), "Running": (75, 18, 171),
    },
    transitions=_numbered({
        "StoppingToStopped": (57, 163), "ClearingToStopped": (58, 164), "StoppedToRunning": (59, 165),
        "RunningToStopping": (60, 166),
    }),
    parts=(Part(56, "ExecuteState", (PACKML, 1), "Running"),),
    variables=_present(153, 154),
    methods={"Stop": MethodType(375), "Reset": MethodType(376)},
    causes={"StoppedToRunning": "Reset", "RunningToStopping": "Stop"},
)  # fmt: skip
BASE_MACHINE = CompanionType(
    PACKML, 3, "PackMLBaseStateMachineType", ("", FINITE_STATE_MACHINE),
    states={"Aborting": (61, 8, 168), "Aborted": (62, 9, 169), "Cleared": (71, 19, 178)},
    transitions=_numbered({
        "AbortedToCleared": (65, 174), "AbortingToAborted": (66, 175), "ClearedToAborting": (67, 176),
    }),
    parts=(Part(64, "MachineState", (PACKML, 2), "Cleared"),),
    variables=_present(167, 158),
    methods={"Clear": MethodType(363), "Abort": MethodType(364)},
    causes={"AbortedToCleared": "Clear", "ClearedToAborting": "Abort"},
)  # fmt: skip
STATUS = CompanionType(
    PACKML, 4, "PackMLStatusObjectType",
    variables=(
        TypeMember(232, "CurMachSpeed", _FLOAT, ANALOG_ITEM),
        TypeMember(211, "EquipmentBlocked", _BOOLEAN),
        TypeMember(224, "EquipmentStarved", _BOOLEAN),
        TypeMember(219, "MachSpeed", _FLOAT, ANALOG_ITEM),
        TypeMember(200, "UnitModeCurrent", _ENUMERATION),
        TypeMember(193, "UnitSupportedModes", _NODE_ID, 0),
    ),
)  # fmt: skip
ADMIN = CompanionType(
    PACKML, 5, "PackMLAdminObjectType",
    variables=(
        TypeMember(252, "AccTimeSinceReset", _INT32, optional=True),
        TypeMember(249, "StateCumulativeTime", _INT32, optional=True, dimensions=2),
        TypeMember(119, "ProdDefectiveCount", COUNT, optional=True, dimensions=1),
        TypeMember(120, "ProdProcessedCount", COUNT, optional=True, dimensions=1),
        TypeMember(276, "Parameter", DESCRIPTOR, optional=True, dimensions=1),
        TypeMember(238, "Alarm", ALARM, optional=True, dimensions=1, reference="HasAlarm"),
        TypeMember(239, "AlarmExtent", _INT32, optional=True),
        TypeMember(240, "AlarmHistory", ALARM, optional=True, dimensions=1, reference="HasAlarmHistory"),
        TypeMember(241, "AlarmHistoryExtent", _INT32, optional=True),
        TypeMember(244, "StopReason", ALARM, optional=True, reference="HasStopReason"),
        TypeMember(245, "StopReasonExtent", _INT32, optional=True),
    ),
)  # fmt: skip
BASE_OBJECT_TYPE = CompanionType(
    PACKML, 6, "PackMLBaseObjectType",
    variables=(
        TypeMember(221, "PackMLVersion", _STRING, 0, optional=True),
        TypeMember(218, "TagID", _STRING, 0, optional=True),
    ),
    parts=(Part(73, "Admin", (PACKML, 5)), Part(87, "Status", (PACKML, 4)), Part(88, "BaseStateMachine", (PACKML, 3))),
    methods={
        "SetUnitMode": MethodType(362, 118, ("RequestedMode", _INT32, False), mandatory=True),
        "SetMachSpeed": MethodType(400, 348, ("RequestedMachineSpeed", _FLOAT, False), mandatory=True),
        "SetProduct": MethodType(401, 349, ("Product", PRODUCT, True), mandatory=True),
        "SetParameter": MethodType(402, 352, ("Parameter", DESCRIPTOR, True), mandatory=True),
    },
)  # fmt: skip
ITEM_MACHINE = CompanionType(
    MACHINERY, 1002, "MachineryItemState_StateMachineType", ("", FINITE_STATE_MACHINE),
    states={
        "NotAvailable": (5005, 0, 6039), "OutOfService": (5004, 1, 6038), "NotExecuting": (5007, 2, 6041),
        "Executing": (5006, 3, 6040),
    },
    transitions={
        "FromNotAvailableToOutOfService": (5008, 0, 6042), "FromNotAvailableToNotExecuting": (5009, 2, 6043),
        "FromNotAvailableToExecuting": (5010, 1, 6044), "FromNotAvailableToNotAvailable": (5011, 12, 6045),
        "FromOutOfServiceToNotAvailable": (5012, 3, 6046), "FromOutOfServiceToNotExecuting": (5013, 5, 6047),
        "FromOutOfServiceToExecuting": (5014, 4, 6048), "FromOutOfServiceToOutOfService": (5015, 13, 6049),
        "FromNotExecutingToNotAvailable": (5016, 9, 6050), "FromNotExecutingToOutOfService": (5017, 10, 6051),
        "FromNotExecutingToExecuting": (5018, 11, 6052), "FromNotExecutingToNotExecuting": (5019, 15, 6053),
        "FromExecutingToNotAvailable": (5020, 6, 6054), "FromExecutingToOutOfService": (5021, 7, 6055),
        "FromExecutingToNotExecuting": (5022, 8, 6056), "FromExecutingToExecuting": (5023, 14, 6057),
    },
)  # fmt: skip
FUNCTIONAL_GROUP = CompanionType(DI, 1005, "FunctionalGroupType", ("", FOLDER))
ITEM_IDENTIFICATION = CompanionType(
    MACHINERY, 1004, "MachineryItemIdentificationType", (DI, 1005),
    variables=(
        TypeMember(6002, "Manufacturer", _TEXT, 0, namespace=DI),
        TypeMember(6003, "SerialNumber", _STRING, 0, namespace=DI),
    ),
)  # fmt: skip
IDENTIFICATION = CompanionType(
    MACHINERY, 1012, "MachineIdentificationType", (MACHINERY, 1004),
    variables=(TypeMember(6015, "ProductInstanceUri", _STRING, 0, namespace=DI),),
)  # fmt: skip

#: Every type, after those that it is made of.
TYPES = (
    EXECUTE_MACHINE, MACHINE_MACHINE, BASE_MACHINE, STATUS, ADMIN, BASE_OBJECT_TYPE, ITEM_MACHINE, FUNCTIONAL_GROUP,
    ITEM_IDENTIFICATION, IDENTIFICATION,
)  # fmt: skip
