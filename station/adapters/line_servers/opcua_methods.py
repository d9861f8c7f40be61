"""What the methods of PackML's types do, and the status code of each that is refused.

A method that the station cannot follow is refused where it is called, with its reason as a sentence; one that is
followed changes the line at its next step, and the nodes say so when it did.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from station.adapters.line_servers import companion_types as types
from station.adapters.line_servers.asyncua_types import opc_ua
from station.adapters.line_servers.companion_structures import StructureType
from station.adapters.line_servers.companion_types import MethodType
from station.adapters.line_servers.facts import LineFacts
from station.adapters.line_servers.machine_states import machine_states
from station.domain.cell.adjustment import (
    ADJUSTABLE,
    MODE_CHANGES_IN,
    REFUSED_IN_MAINTENANCE,
    LineAdjustment,
    UnitMode,
)
from station.domain.cell.packml import TRANSITIONS, Command, refusal
from station.messages import Message, render

#: Data types of the base namespace that arguments have.
_TYPE_NAMES = {6: "Int32", 10: "Float"}


class _RefusedCallError(Exception):
    """code: a status of OPC UA, by name."""

    def __init__(self, code: str, why: Message) -> None:
        super().__init__(code)
        self.code, self.why = code, why


@dataclass(slots=True)
class LineMethods:
    """facts: what the line says now; send, adjust: give it a command, a mode and times; last_refusal: the sentence of
    the newest call that was refused, '' after one that was not."""

    facts: Callable[[], LineFacts]
    send: Callable[[Command], None]
    adjust: Callable[[LineAdjustment], None]
    last_refusal: str = field(default="", init=False)

    def command(self, command: Command, depth: int) -> Callable[..., Any]:
        """A method of the state machine at that depth, 0 the outer one. Start takes parameters too."""

        def call(parameters: Sequence[Any] = ()) -> None:
            facts = self._running()
            self._allow(command, depth, facts)
            if parameters:
                self.adjust(_adjusted(facts, parameters))
            self.send(command)

        start = types.EXECUTE_MACHINE.methods["Start"]
        return self._answering(call, start if command is Command.START else MethodType(0))

    def setters(self) -> Mapping[str, Callable[..., Any]]:
        """The methods of PackMLBaseObjectType, by name."""
        calls: dict[str, Callable[..., None]] = {
            "SetUnitMode": self._set_mode,
            "SetMachSpeed": self._refuse_speed,
            "SetProduct": self._refuse_product,
            "SetParameter": self._set_parameters,
        }
        return {name: self._answering(calls[name], kind) for name, kind in types.BASE_OBJECT_TYPE.methods.items()}

    def _running(self) -> LineFacts:
        facts = self.facts()
        if facts.state is None:
            raise _RefusedCallError("BadOutOfService", Message("opcua-no-line"))
        return facts

    @staticmethod
    def _allow(command: Command, depth: int, facts: LineFacts) -> None:
        assert facts.state is not None
        if facts.state not in TRANSITIONS[command]:
            inactive = machine_states(facts.state)[depth] == ""
            raise _RefusedCallError(
                "BadStateNotActive" if inactive else "BadInvalidState", refusal(facts.state, command)
            )
        if facts.mode == UnitMode.MAINTENANCE and command in REFUSED_IN_MAINTENANCE:
            raise _RefusedCallError("BadInvalidState", Message("line-in-maintenance", command=command.label))

    def _set_mode(self, requested: int) -> None:
        facts = self._running()
        if requested not in set(UnitMode):
            modes = [f"{mode.value} {mode.label}" for mode in UnitMode]
            raise _RefusedCallError("BadNotSupported", Message("opcua-mode-unknown", mode=requested, modes=modes))
        if requested != facts.mode and facts.state not in MODE_CHANGES_IN:
            assert facts.state is not None
            states = sorted(state.label for state in MODE_CHANGES_IN)
            why = Message("opcua-mode-not-now", state=facts.state.label, states=states)
            raise _RefusedCallError("BadInvalidState", why)
        self.adjust(LineAdjustment(UnitMode(requested), facts.times_s))

    def _refuse_speed(self, requested: float) -> None:
        raise _RefusedCallError("BadNotSupported", Message("opcua-speed", speed=float(requested)))

    def _refuse_product(self, _products: Sequence[Any]) -> None:
        recipe = self._running().recipe
        raise _RefusedCallError("BadNotSupported", Message("opcua-product", recipe=recipe))

    def _set_parameters(self, parameters: Sequence[Any]) -> None:
        self.adjust(_adjusted(self._running(), parameters))

    def _answering(self, call: Callable[..., None], kind: MethodType) -> Callable[..., Any]:
        """As a server calls it: with variants, for a status code."""
        ua = opc_ua()

        def answer(_parent: Any, *given: Any) -> Any:
            try:
                _check_arguments(given, kind)
                call(*(() if value.Value is None else value.Value for value in given))
            except _RefusedCallError as refused:
                self.last_refusal = render(refused.why)
                return ua.StatusCode(getattr(ua.StatusCodes, refused.code))
            self.last_refusal = ""
            return ua.StatusCode()

        return answer


def _check_arguments(given: Sequence[Any], kind: MethodType) -> None:
    """Count and type of variants. What is optional to give is the argument of a method that is optional."""
    least, most = int(kind.mandatory), int(kind.argument is not None)
    if not least <= len(given) <= most:
        code = "BadArgumentsMissing" if len(given) < least else "BadTooManyArguments"
        raise _RefusedCallError(code, Message("opcua-arguments", count=len(given), most=most))
    for variant in given:
        assert kind.argument is not None
        name, wanted, is_list = kind.argument
        if not _is_of_type(variant, wanted, is_list=is_list):
            type_name = wanted.name if isinstance(wanted, StructureType) else _TYPE_NAMES[wanted]
            raise _RefusedCallError("BadInvalidArgument", Message("opcua-argument-type", name=name, type=type_name))


def _is_of_type(variant: Any, wanted: int | StructureType, *, is_list: bool) -> bool:
    if not isinstance(wanted, StructureType):
        return variant.VariantType.value == wanted and not isinstance(variant.Value, list)
    values = variant.Value if is_list else [variant.Value]
    made = getattr(opc_ua(), wanted.name)
    return values is None or (isinstance(values, list) and all(isinstance(value, made) for value in values))


def _adjusted(facts: LineFacts, parameters: Sequence[Any]) -> LineAdjustment:
    """All or nothing: one that is wrong refuses them all."""
    times_s = dict(facts.times_s)
    for given in parameters:
        known = ADJUSTABLE.get(given.ID)
        if known is None or given.Name not in (None, "", known.name):
            names = [f"{number} {time.name}" for number, time in ADJUSTABLE.items()]
            why = Message("opcua-parameter-unknown", id=given.ID, name=str(given.Name or "")[:40], names=names)
            raise _RefusedCallError("BadInvalidArgument", why)
        if not (math.isfinite(given.Value) and known.least_s <= given.Value <= known.most_s):
            limits = {"least_s": known.least_s, "most_s": known.most_s}
            why = Message("opcua-parameter-range", name=known.name, value=repr(given.Value), **limits)
            raise _RefusedCallError("BadOutOfRange", why)
        times_s[known.name] = round(float(given.Value), 6)
    return LineAdjustment(UnitMode(facts.mode), times_s)
