"""The types of `companion_types` in an OPC UA server: object types with their members, states and transitions."""

from collections.abc import Mapping
from typing import Any

from station.adapters.line_servers.companion_types import (
    DI,
    MACHINERY,
    MODE_ENUM,
    PACKML,
    TYPES,
    CompanionType,
    NodeOf,
    TypeMember,
)

#: Nodes of the base namespace: types of a state and of a transition; references; ranges of an analog item.
_STATE, _TRANSITION, _ENUMERATION = 2307, 2310, 29
_FROM, _TO, _CAUSE, _SUB_MACHINE = 51, 52, 53, 117
#: Modes of OPC 30050, 6.5.2; the station has the second.
_MODES = ("Invalid", "Produce", "Maintenance", "Manual")


def opc_ua() -> Any:
    """The package's own types, loaded late: it takes a second."""
    from asyncua import ua

    return ua


async def add_companion_types(server: Any) -> dict[str, int]:
    """Adds the namespaces and their types; the index of each namespace. Call it once on a server."""
    spaces = {"": 0}
    for uri in (PACKML, MACHINERY, DI):
        spaces[uri] = await server.register_namespace(uri)
    await _add_mode_enumeration(server, spaces)
    for made in TYPES:
        await _add_type(server, spaces, made)
    return spaces


def node_id(spaces: Mapping[str, int], of: NodeOf) -> Any:
    """The node id of a specification's node."""
    ua = opc_ua()
    return ua.NodeId(of[1], spaces[of[0]])


def initial_value(data_type: int) -> Any:
    """What a variable of a base data type holds before anything is known."""
    ua = opc_ua()
    start: dict[int, tuple[Any, Any]] = {
        1: (False, ua.VariantType.Boolean),
        6: (0, ua.VariantType.Int32),
        10: (0.0, ua.VariantType.Float),
        12: ("", ua.VariantType.String),
        17: (ua.NodeId(), ua.VariantType.NodeId),
        21: (ua.LocalizedText(""), ua.VariantType.LocalizedText),
        29: (0, ua.VariantType.Int32),
    }
    return ua.Variant(*start[data_type])


async def add_variable(parent: Any, node: Any, name: Any, given: TypeMember) -> Any:
    """One variable or property, typed as the specification says."""
    from asyncua.common.instantiate_util import instantiate
    from asyncua.common.node import Node

    ua = opc_ua()
    start = initial_value(given.data_type)
    data_type = ua.NodeId(given.data_type)
    if not given.kind:
        return await parent.add_property(node, name, start, datatype=data_type)
    if given.kind == ua.ObjectIds.BaseDataVariableType:
        return await parent.add_variable(node, name, start, datatype=data_type)
    of = Node(parent.session, ua.NodeId(given.kind))
    text = ua.LocalizedText(name.Name)
    added = (await instantiate(parent, of, node, name, text, instantiate_optional=False))[0]
    await added.write_attribute(ua.AttributeIds.DataType, ua.DataValue(ua.Variant(data_type)))
    await added.write_value(start)
    return added


async def _add_mode_enumeration(server: Any, spaces: Mapping[str, int]) -> None:
    ua = opc_ua()
    index = spaces[PACKML]
    parent = server.get_node(ua.NodeId(_ENUMERATION))
    name = ua.QualifiedName("ProductionMaintenanceModeEnum", index)
    made = await parent.add_data_type(ua.NodeId(MODE_ENUM, index), name)
    names = [ua.LocalizedText(mode) for mode in _MODES]
    await made.add_property(ua.NodeId(194, index), ua.QualifiedName("EnumStrings"), names)


async def _add_type(server: Any, spaces: Mapping[str, int], given: CompanionType) -> None:
    ua = opc_ua()
    index = spaces[given.namespace]

    def name_of(name: str, namespace: str = "") -> Any:
        return ua.QualifiedName(name, spaces[namespace] if namespace else index)

    base = server.get_node(node_id(spaces, given.base))
    made = await base.add_object_type(ua.NodeId(given.node, index), name_of(given.name))
    for variable in given.variables:
        node = ua.NodeId(variable.node, index)
        added = await add_variable(made, node, name_of(variable.name, variable.namespace), variable)
        if variable.optional:
            await added.set_modelling_rule(False)
        else:
            await _make_mandatory(added)
    methods = {}
    for name, number in given.methods.items():
        methods[name] = await made.add_method(ua.NodeId(number, index), name_of(name), None, [], [])
        await methods[name].set_modelling_rule(False)
    states = {}
    for name, numbers in given.states.items():
        states[name] = await _numbered(made, index, name, numbers, "StateNumber")
    for name, numbers in given.transitions.items():
        transition = await _numbered(made, index, name, numbers, "TransitionNumber")
        begin, end = ends_of(name)
        await transition.add_reference(states[begin], _FROM, bidirectional=False)
        await transition.add_reference(states[end], _TO, bidirectional=False)
        if name in given.causes:
            await transition.add_reference(methods[given.causes[name]], _CAUSE, bidirectional=False)
    for part in given.parts:
        node, of = ua.NodeId(part.node, index), node_id(spaces, part.of)
        added = await made.add_object(node, name_of(part.name), of, instantiate_optional=False)
        await _make_mandatory(added)
        if part.substate_of:
            await states[part.substate_of].add_reference(added, _SUB_MACHINE, bidirectional=False)


def ends_of(transition: str) -> tuple[str, str]:
    """`ExecuteToHolding` or `FromExecutingToNotExecuting`: the states that it lies between."""
    begin, _, end = transition.removeprefix("From").partition("To")
    return begin, end


async def _make_mandatory(node: Any) -> None:
    """Every instance of the type gets this part with all that is below it."""
    await node.set_modelling_rule(True)
    for child in await node.get_children():
        await _make_mandatory(child)


async def _numbered(made: Any, index: int, name: str, numbers: tuple[int, int, int], property_name: str) -> Any:
    """A state or a transition with its number."""
    ua = opc_ua()
    node, number, held = numbers
    kind = _STATE if property_name == "StateNumber" else _TRANSITION
    added = await made.add_object(
        ua.NodeId(node, index), ua.QualifiedName(name, index), ua.NodeId(kind), instantiate_optional=False
    )
    made_with_it = await added.get_child(f"0:{property_name}")  # under a number of the server's own
    await made_with_it.delete()
    value = ua.Variant(number, ua.VariantType.UInt32)
    await added.add_property(ua.NodeId(held, index), ua.QualifiedName(property_name), value)
    return added
