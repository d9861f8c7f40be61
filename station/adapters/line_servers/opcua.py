"""The station's outer state over OPC UA (asyncua): PackML's three state machines with status, counts, times and alarms,
Machinery's item state and identification, and the units with their results by nest.

Types, names and node ids are those of OPC 30050 and OPC 40001-1, as far as the station uses them.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping, Sequence
from typing import Any

from station.adapters.line_servers import companion_types as types
from station.adapters.line_servers.asyncua_types import opc_ua
from station.adapters.line_servers.companion_space import (
    add_arguments,
    add_companion_types,
    add_reference_of_own,
    add_variable,
    node_id,
)
from station.adapters.line_servers.facts import LineFacts
from station.adapters.line_servers.machine_states import MACHINES, machine_states
from station.adapters.line_servers.opcua_admin import admin_values
from station.adapters.line_servers.opcua_methods import LineMethods
from station.adapters.line_servers.serving import ServedLine
from station.domain.cell.packml import Command, State
from station.errors import ConfigError

NAMESPACE = "urn:can-calibration-station:line"
MANUFACTURER = "CAN calibration station"
#: So often the nodes follow the line's word, s.
INTERVAL_S = 0.2
ITEM_STATES = ("NotAvailable", "OutOfService", "NotExecuting", "Executing")
_TEXTS = ("Serial", "Result")
_STATUS = (
    "EquipmentBlocked", "EquipmentStarved", "UnitModeCurrent", "UnitSupportedModes", "CurMachSpeed", "MachSpeed",
)  # fmt: skip
#: Upper end of the range of both speeds: a unit a second.
MOST_UNITS_AN_HOUR = 3600.0
#: Nodes of the base namespace.
_ORGANIZES, _HAS_COMPONENT, _HAS_ADD_IN = 35, 47, 17604


async def serve_opcua(line: ServedLine) -> None:
    """Serves nodes in a loop of asyncio. Errors: OSError where it cannot listen, ConfigError without asyncua."""
    endpoint = f"opc.tcp://{line.host}:{line.port}"
    try:
        from asyncua import ua
        from asyncua.server.server import Server
    except ImportError:
        raise ConfigError("extra-missing", package="asyncua", extra="line") from None
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)
    server = Server()
    await server.init()
    server.set_endpoint(endpoint)
    server.set_server_name("CAN calibration station")
    server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
    own, spaces = await server.register_namespace(NAMESPACE), await add_companion_types(server)
    space = _Space(server, own, spaces, LineMethods(line.facts, line.send, line.adjust))
    await space.build(line.facts())
    async with server:
        line.ready(endpoint)
        while True:
            await space.follow(line.facts())
            await asyncio.sleep(INTERVAL_S)


class _Space:
    """The station among the server's objects. nodes: what is written, by name; nests as `Nests/A/Serial`."""

    def __init__(self, server: Any, own: int, spaces: Mapping[str, int], methods: LineMethods) -> None:
        self._server, self._own, self._spaces, self._methods = server, own, spaces, methods
        self._nodes: dict[str, Any] = {}

    async def build(self, facts: LineFacts) -> None:
        """Every node, once."""
        root = await self._server.nodes.objects.add_object(self._own, "CalibrationStation")
        await self._add_packml(root)
        await self._add_machinery(root)
        status = await root.add_object(self._own, "Status")
        for name, value in (("Recipe", ""), ("Load", 0), ("LoadsDone", 0), ("Why", ""), ("Refusal", "")):
            self._nodes[name] = await status.add_variable(self._own, name, value)
        seats = await root.add_object(self._own, "Nests")
        for nest, _, _ in facts.nests:
            folder = await seats.add_object(self._own, nest)
            for name in _TEXTS:
                self._nodes[f"Nests/{nest}/{name}"] = await folder.add_variable(self._own, name, "")

    async def _add_packml(self, root: Any) -> None:
        ua = opc_ua()
        index = self._spaces[types.PACKML]
        machine = await self._add(root, "PackML", types.BASE_OBJECT_TYPE, self._own)
        for name in ("PackMLVersion", "TagID"):
            self._nodes[name] = await machine.add_property(self._own, name, "")
            await self._nodes[name].write_attribute(
                ua.AttributeIds.BrowseName, ua.DataValue(ua.Variant(ua.QualifiedName(name, index)))
            )
        await self._nodes["PackMLVersion"].write_value(types.PACKML_VERSION)
        for depth, (way, kind) in enumerate(MACHINES):
            found = await machine.get_child([ua.QualifiedName(name, index) for name in way])
            await self._add_machine(found, way, kind, depth)
        for name, call in self._methods.setters().items():
            self._server.link_method(await machine.get_child(f"{index}:{name}"), call)
        for name in _STATUS:
            self._nodes[name] = await machine.get_child([f"{index}:Status", f"{index}:{name}"])
        for name in ("CurMachSpeed", "MachSpeed"):
            units_an_hour = await self._nodes[name].get_child("0:EURange")
            await units_an_hour.write_value(ua.Range(0.0, MOST_UNITS_AN_HOUR))
        await self._nodes["UnitSupportedModes"].write_value(node_id(self._spaces, (types.PACKML, types.MODE_ENUM)))
        admin = await machine.get_child(f"{index}:Admin")
        for given in types.ADMIN.variables:
            node, browse = ua.NodeId(f"Admin/{given.name}", self._own), ua.QualifiedName(given.name, index)
            self._nodes[given.name] = added = await add_variable(admin, node, browse, given, index)
            await add_reference_of_own(admin, added, given, index)
        await self._list(types.PACKML, types.PACKML_OBJECTS, "PackMLObjects", machine)

    async def _add_machine(self, found: Any, way: Sequence[str], kind: types.CompanionType, depth: int) -> None:
        """State, lists and methods of one state machine of PackML."""
        ua = opc_ua()
        index = self._spaces[types.PACKML]
        current = await found.get_child("0:CurrentState")
        self._nodes[way[-1]], self._nodes[f"{way[-1]}/Id"] = current, await current.get_child("0:Id")
        for name, numbers in (("AvailableStates", kind.states), ("AvailableTransitions", kind.transitions)):
            present = [ua.NodeId(node, index) for node, *_ in numbers.values()]
            await (await found.get_child(f"0:{name}")).write_value(ua.Variant(present, ua.VariantType.NodeId))
        for name, given in kind.methods.items():
            command = Command.COMPLETE if name == "ToComplete" else Command[name.upper()]
            node, browse = ua.NodeId("/".join((*way, name)), self._own), ua.QualifiedName(name, index)
            method = await found.add_method(node, browse, self._methods.command(command, depth), [], [])
            await add_arguments(method, ua.NodeId(f"{node.Identifier}/InputArguments", self._own), given, index)

    async def _add_machinery(self, root: Any) -> None:
        ua = opc_ua()
        machinery, di = self._spaces[types.MACHINERY], self._spaces[types.DI]
        name = ua.QualifiedName("MachineryBuildingBlocks", machinery)
        blocks = await root.add_folder(ua.NodeId("MachineryBuildingBlocks", self._own), name)
        item = await self._add(blocks, "MachineryItemState", types.ITEM_MACHINE, machinery, _HAS_ADD_IN)
        current = await item.get_child("0:CurrentState")
        self._nodes["MachineryItemState"] = current
        self._nodes["MachineryItemState/Id"] = await current.get_child("0:Id")
        plate = await self._add(blocks, "Identification", types.IDENTIFICATION, di, _HAS_ADD_IN)
        for name in ("Manufacturer", "SerialNumber", "ProductInstanceUri"):
            self._nodes[name] = await plate.get_child(f"{di}:{name}")
        await self._nodes["Manufacturer"].write_value(ua.LocalizedText(MANUFACTURER))
        await self._list(types.MACHINERY, types.MACHINES, "Machines", root)

    async def _add(
        self, parent: Any, name: str, kind: types.CompanionType, space: int, reference: int = _HAS_COMPONENT
    ) -> Any:
        """An instance with what its type makes mandatory."""
        ua = opc_ua()
        of = node_id(self._spaces, (kind.namespace, kind.node))
        browse = ua.QualifiedName(name, space)
        added = await parent.add_object(ua.NodeId(name, self._own), browse, of, instantiate_optional=False)
        if reference == _HAS_ADD_IN:  # a folder organizes what is added to it
            await parent.delete_reference(added, _ORGANIZES)
            await parent.add_reference(added, reference)
        return added

    async def _list(self, namespace: str, node: int, name: str, entry: Any) -> None:
        """The folder of the specification in which clients look for such objects."""
        ua = opc_ua()
        index = self._spaces[namespace]
        folder = await self._server.nodes.objects.add_folder(ua.NodeId(node, index), ua.QualifiedName(name, index))
        await folder.add_reference(entry, _ORGANIZES)

    async def follow(self, facts: LineFacts) -> None:
        """Writes what the line says now."""
        ua = opc_ua()
        for (way, kind), name in zip(MACHINES, machine_states(facts.state), strict=True):
            await self._set_state(way[-1], kind, name)
        await self._set_state("MachineryItemState", types.ITEM_MACHINE, ITEM_STATES[facts.item_state])
        values: dict[str, Any] = {
            "Why": facts.why,
            "Recipe": facts.recipe,
            "Load": facts.load,
            "LoadsDone": facts.loads,
            "TagID": facts.station,
            "SerialNumber": facts.station,
            "ProductInstanceUri": f"urn:can-calibration-station:{facts.station}",
            "EquipmentStarved": facts.state is State.SUSPENDED,
            "UnitModeCurrent": ua.Variant(facts.mode, ua.VariantType.Int32),
            "CurMachSpeed": ua.Variant(facts.speed, ua.VariantType.Float),
            "Refusal": self._methods.last_refusal,
        }
        for nest, serial, outcome in facts.nests:
            values |= {f"Nests/{nest}/Serial": serial, f"Nests/{nest}/Result": outcome}
        for name, value in (values | admin_values(facts)).items():
            if name in self._nodes:
                await self._nodes[name].write_value(value)
        await self._nodes["MachSpeed"].write_value(_set_speed(facts))

    async def _set_state(self, name: str, kind: types.CompanionType, state: str) -> None:
        """Current state and its node of one machine; '' where its outer machine is in another state."""
        ua = opc_ua()
        text = state or "NotAvailable"
        known = (kind.namespace, kind.states[state][0]) if state in kind.states else None
        await self._nodes[name].write_value(ua.LocalizedText(text))
        await self._nodes[f"{name}/Id"].write_value(ua.NodeId() if known is None else node_id(self._spaces, known))


def _set_speed(facts: LineFacts) -> Any:
    """Units an hour of the ideal time; nobody knows it where config.yaml does not say `ideal_s`."""
    ua = opc_ua()
    if facts.ideal_s <= 0:
        return ua.DataValue(StatusCode=ua.StatusCode(ua.StatusCodes.BadNoData))
    return ua.DataValue(ua.Variant(3600.0 / facts.ideal_s, ua.VariantType.Float))
