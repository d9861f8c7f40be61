"""Structured data types of OPC 30050 (PackML) that the line's server uses, as tables, and how a server gets them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from station.adapters.line_servers.asyncua_types import opc_ua

#: Numbers in the base namespace.
_BOOLEAN, _INT32, _FLOAT, _STRING, _UTC_TIME, _UNIT = 1, 6, 10, 12, 294, 887


@dataclass(frozen=True, slots=True)
class StructureType:
    """node, encoding: of the type and its binary encoding; fields: name, type (as a number of the base namespace where
    it is no structure) and whether it is a list."""

    node: int
    encoding: int
    name: str
    fields: tuple[tuple[str, int | StructureType, bool], ...]


COUNT = StructureType(
    14, 69, "PackMLCountDataType",
    (
        ("ID", _INT32, False), ("Name", _STRING, False), ("Unit", _UNIT, False), ("Count", _INT32, False),
        ("AccCount", _INT32, False),
    ),
)  # fmt: skip
ALARM = StructureType(
    15, 74, "PackMLAlarmDataType",
    (
        ("ID", _INT32, False), ("Value", _INT32, False), ("Message", _STRING, False), ("Category", _INT32, False),
        ("DateTime", _UTC_TIME, False), ("AckDateTime", _UTC_TIME, False), ("Trigger", _BOOLEAN, False),
    ),
)  # fmt: skip
DESCRIPTOR = StructureType(
    16, 77, "PackMLDescriptorDataType",
    (("ID", _INT32, False), ("Name", _STRING, False), ("Unit", _UNIT, False), ("Value", _FLOAT, False)),
)  # fmt: skip
INGREDIENTS = StructureType(
    17, 79, "PackMLIngredientsDataType", (("IngredientID", _INT32, False), ("Parameter", DESCRIPTOR, True))
)
PRODUCT = StructureType(
    18, 81, "PackMLProductDataType",
    (("ProductID", _INT32, False), ("ProcessVariables", DESCRIPTOR, True), ("Ingredients", INGREDIENTS, True)),
)  # fmt: skip
#: Every structure, after those that it is made of.
STRUCTURES = (COUNT, ALARM, DESCRIPTOR, INGREDIENTS, PRODUCT)


def data_type_id(index: int, given: int | StructureType) -> Any:
    """The node id of a data type. index: of PackML's namespace."""
    ua = opc_ua()
    return ua.NodeId(given.node, index) if isinstance(given, StructureType) else ua.NodeId(given)


async def add_structures(server: Any, index: int) -> None:
    """Adds them to a server. index: of PackML's namespace."""
    for given in STRUCTURES:
        await _add_structure(server, index, given)


async def _add_structure(server: Any, index: int, given: StructureType) -> None:
    from asyncua.common.manage_nodes import create_data_type, create_encoding
    from asyncua.common.structures104 import load_custom_struct, new_struct_field

    ua = opc_ua()
    base = server.nodes.base_structure_type
    made = await create_data_type(base, ua.NodeId(given.node, index), ua.QualifiedName(given.name, index))
    encoding = await create_encoding(made, ua.NodeId(given.encoding, index), ua.QualifiedName("Default Binary", 0))
    definition = ua.StructureDefinition()
    definition.BaseDataType, definition.DefaultEncodingId = base.nodeid, encoding.nodeid
    definition.StructureType = ua.StructureType.Structure
    definition.Fields = [new_struct_field(name, data_type_id(index, of), array) for name, of, array in given.fields]
    await made.write_data_type_definition(definition)
    await load_custom_struct(made)
