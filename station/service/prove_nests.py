"""Which nest an unlabelled unit sits in: a person empties one nest at a time, and the unit that falls silent is its.

Nothing is written before all nests are proven; then each unit is given the id of its nest as a labelled one is.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

from station.domain.product.taken_out import unit_left_over, unit_taken_out
from station.errors import WrongUnit
from station.messages import Message
from station.ports.lss import LssIdentity
from station.service.commission import (
    AddressedDevice,
    Commissioned,
    CommissioningBench,
    How,
    NodeSeat,
    addressed_message,
    assign_nodes,
    identity_at,
)

#: So often a person is asked for one nest.
_MOST_ASKED = 3
_PROVEN: How = "proven"
Tell = Callable[[Message], None]


def assign_proven_nodes(
    bench: CommissioningBench, seats: Sequence[NodeSeat], hint: LssIdentity | None, tell: Tell, confirm: Tell
) -> Commissioned:
    """assign_nodes, then the proof of every nest without a label; no proof where a nest is empty or a unit left over.

    confirm: has a person do something and returns when it is done. Errors: those of assign_nodes; WrongUnit where a
    nest stays unclear.
    """
    confirm(Message("commission-fill-all"))
    found = assign_nodes(bench, seats, hint, tell)
    unlabelled = [seat.nest for seat in seats if seat.identity is None]
    if not found.complete or len(unlabelled) < 2:
        return found
    proven = _proven_nests(bench, found.devices, unlabelled, tell, confirm)
    final = assign_nodes(bench, [replace(s, identity=proven.get(s.nest, s.identity)) for s in seats], hint)
    how = {d.nest: d.how for d in found.devices} | dict.fromkeys(proven, _PROVEN)
    devices = tuple(replace(d, how=how[d.nest]) for d in final.devices)
    for device in devices:
        if device.nest in proven:
            tell(addressed_message(device))
    return Commissioned(devices, final.findings)


def _proven_nests(
    bench: CommissioningBench, devices: Sequence[AddressedDevice], unlabelled: Sequence[str], tell: Tell, confirm: Tell
) -> dict[str, LssIdentity]:
    """Nest → identity. The last nest has the unit that no other has, so one act less is needed."""
    labelled = {d.identity for d in devices if d.nest not in unlabelled}
    units = {d.identity for d in devices}
    proven: dict[str, LssIdentity] = {}
    for nest in unlabelled:
        elsewhere = labelled | set(proven.values())
        proven[nest] = unit_left_over(units, elsewhere) or _unit_of(bench, devices, nest, elsewhere, tell, confirm)
    confirm(Message("commission-put-back"))
    _silent(bench, devices)  # waits for the boot; assign_nodes names whoever is still missing
    return proven


def _unit_of(
    bench: CommissioningBench,
    devices: Sequence[AddressedDevice],
    nest: str,
    elsewhere: set[LssIdentity],
    tell: Tell,
    confirm: Tell,
) -> LssIdentity:
    """Asks until exactly one unit is silent that is not proven elsewhere. Errors: WrongUnit."""
    for _ in range(_MOST_ASKED):
        confirm(Message("commission-take-out", nest=nest))
        silent = _silent(bench, devices)
        unit = unit_taken_out(silent, elsewhere)
        if unit is not None:
            return unit
        serials = tuple(sorted(identity.serial for identity in silent))
        tell(
            Message("commission-others-silent", nest=nest, serials=serials)
            if serials
            else Message("commission-none-silent", nest=nest)
        )
    raise WrongUnit("commission-nest-unclear", nest=nest, count=_MOST_ASKED)


def _silent(bench: CommissioningBench, devices: Sequence[AddressedDevice]) -> set[LssIdentity]:
    """Who does not answer, though a unit that was just put back has had the time to boot."""
    deadline_s = bench.clock.monotonic_s() + bench.boot_s
    waiting = list(devices)
    while True:
        waiting = [d for d in waiting if identity_at(bench, d.node) != d.identity]
        if not waiting or bench.clock.monotonic_s() >= deadline_s:
            return {d.identity for d in waiting}
