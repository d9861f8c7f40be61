"""The types of `companion_types` in an OPC UA server: object types with their members, states and transitions."""

from collections.abc import Mapping
from typing import Any

from station.adapters.line_servers.asyncua_types import opc_ua
from station.adapters.line_servers.companion_structures import StructureType, add_structures, data_type_id
from station.adapters.line_servers.companion_types import (
    DI,
    MACHINERY,
    MODE_ENUM,
    PACKML,
    REFERENCES,
    TYPES,
    CompanionType,
    MethodType,
    NodeOf,
    TypeMember,
)

#: Nodes of the base namespace: types of a state and of a transition; references; ranges of an analog item.
_STATE, _TRANSITION, _ENUMERATION = 2307, 2310, 29
_FROM, _TO, _CAUSE, _SUB_MACHINE = 51, 52, 53, 117
#: Modes of OPC 30050, 6.5.2; the station has the second.
_MODES = ("Invalid", "Produce", "Maintenance", "Manual")


async def add_companion_types(server: Any) -> dict[str, int]:
    """Adds the namespaces and their types; the index of each namespace. Call it once on a server."""
    spaces = {"": 0}
    for uri in (PACKML, MACHINERY, DI):
        spaces[uri] = await server.register_namespace(uri)
    await _add_mode_enumeration(server, spaces)
    await add_structures(server, spaces[PACKML])
    await _add_reference_types(server, spaces[PACKML])
    for made in TYPES:
        await _add_type(server, spaces, made)
    return spaces


def node_id(spaces: Mapping[str, int], of: NodeOf) -> Any:
    """The node id of a specification's node."""
    ua = opc_ua()
    return ua.NodeId(of[1], spaces[of[0]])


def initial_value(given: TypeMember) -> Any:
    """What a variable holds before anything is known."""
    ua = opc_ua()
    if isinstance(given.data_type, StructureType):
        empty = [] if given.dimensions else getattr(ua, given.data_type.name)()
        return ua.Variant(empty, ua.VariantType.ExtensionObject, is_array=given.dimensions > 0)
    start: dict[int, tuple[Any, Any]] = {
        1: (False, ua.VariantType.Boolean),
        6: (0, ua.VariantType.Int32),
        10: (0.0, ua.VariantType.Float),
        12: ("", ua.VariantType.String),
        17: (ua.NodeId(), ua.VariantType.NodeId),
        21: (ua.LocalizedText(""), ua.VariantType.LocalizedText),
        29: (0, ua.VariantType.Int32),
    }
    value, kind = start[given.data_type]
    return ua.Variant([], kind, is_array=True) if given.dimensions else ua.Variant(value, kind)


async def add_variable(parent: Any, node: Any, name: Any, given: TypeMember, packml: int) -> Any:
    """One variable or property, typed as the specification says. packml: index of PackML's namespace."""
    from asyncua.common.instantiate_util import instantiate
    from asyncua.common.node import Node

    ua = opc_ua()
    start = initial_value(given)
    data_type = data_type_id(packml, given.data_type)
    if not given.kind:
        return await parent.add_property(node, name, start, datatype=data_type)
    if given.kind == ua.ObjectIds.BaseDataVariableType:
        added = await parent.add_variable(node, name, start, datatype=data_type)
        await _set_rank(added, given.dimensions or -1)
        return added
    of = Node(parent.session, ua.NodeId(given.kind))
    text = ua.LocalizedText(name.Name)
    added = (await instantiate(parent, of, node, name, text, instantiate_optional=False))[0]
    await added.write_attribute(ua.AttributeIds.DataType, ua.DataValue(ua.Variant(data_type)))
    await _set_rank(added, given.dimensions or -1)
    await added.write_value(start)
    return added


async def add_reference_of_own(parent: Any, node: Any, given: TypeMember, packml: int) -> None:
    """Where the specification hangs a member to its parent by a reference of its own, it is that and no other."""
    ua = opc_ua()
    if given.reference:
        await parent.delete_reference(node, ua.ObjectIds.HasComponent)
        await parent.add_reference(node, ua.NodeId(REFERENCES[given.reference], packml))


async def _set_rank(node: Any, rank: int) -> None:
    ua = opc_ua()
    value = ua.DataValue(ua.Variant(rank, ua.VariantType.Int32))
    await node.write_attribute(ua.AttributeIds.ValueRank, value)


async def _add_reference_types(server: Any, index: int) -> None:
    ua = opc_ua()
    base = server.get_node(ua.ObjectIds.HasComponent)
    for name, number in REFERENCES.items():
        await base.add_reference_type(ua.NodeId(number, index), ua.QualifiedName(name, index))


async def _add_mode_enumeration(server: Any, spaces: Mapping[str, int]) -> None:
    ua = opc_ua()
    index = spaces[PACKML]
    parent = server.get_node(ua.NodeId(_ENUMERATION))
    name = ua.QualifiedName("ProductionMaintenanceModeEnum", index)
    made = await parent.add_data_type(ua.NodeId(MODE_ENUM, index), name)
    values = [ua.EnumValueType(number, ua.LocalizedText(mode)) for number, mode in enumerate(_MODES)]
    given = ua.Variant(values, ua.VariantType.ExtensionObject)
    of_values = ua.NodeId(ua.ObjectIds.EnumValueType)
    held = await made.add_property(ua.NodeId(194, index), ua.QualifiedName("EnumValues"), given, datatype=of_values)
    await _set_rank(held, 1)


async def _add_type(server: Any, spaces: Mapping[str, int], given: CompanionType) -> None:
    ua = opc_ua()
    index = spaces[given.namespace]

    def name_of(name: str, namespace: str = "") -> Any:
        return ua.QualifiedName(name, spaces[namespace] if namespace else index)

    base = server.get_node(node_id(spaces, given.base))
    made = await base.add_object_type(ua.NodeId(given.node, index), name_of(given.name))
    for variable in given.variables:
        node = ua.NodeId(variable.node, index)
        name = ua.QualifiedName(variable.name) if variable.base_name else name_of(variable.name, variable.namespace)
        added = await add_variable(made, node, name, variable, spaces[PACKML])
        await add_reference_of_own(made, added, variable, spaces[PACKML])
        if variable.optional:
            await added.set_modelling_rule(False)
        else:
            await _make_mandatory(added)
    methods = {}
    for method, kind in given.methods.items():
        methods[method] = await _add_method_type(made, index, method, kind)
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


async def _add_method_type(made: Any, index: int, name: str, given: MethodType) -> Any:
    ua = opc_ua()
    added = await made.add_method(ua.NodeId(given.node, index), ua.QualifiedName(name, index), None, [], [])
    await added.set_modelling_rule(given.mandatory)
    if given.argument is not None:
        await add_arguments(added, ua.NodeId(given.arguments_node, index), given, index)
    return added


async def add_arguments(method: Any, node: Any, given: MethodType, index: int) -> None:
    """The property that says what a method wants. index: of PackML's namespace."""
    ua = opc_ua()
    if given.argument is None:
        return
    argument = ua.Argument()
    argument.Name, data_type, array = given.argument
    argument.DataType = data_type_id(index, data_type)
    argument.ValueRank, argument.ArrayDimensions = (1, [0]) if array else (-1, [])
    name, kind = ua.QualifiedName("InputArguments"), ua.VariantType.ExtensionObject
    added = await method.add_property(node, name, [argument], kind, ua.NodeId(ua.ObjectIds.Argument))
    await _set_rank(added, 1)
    await added.set_modelling_rule(True)


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
