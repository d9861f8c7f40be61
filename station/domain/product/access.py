"""How a product's objects are reached where it speaks no CANopen: the `uds` and `template` blocks of its map."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, field_validator

from station.domain.core.types import EXTENDED
from station.domain.product.frame_pattern import parse_pattern
from station.domain.recipe.fields import Name, Positive, StrictModel
from station.errors import InvalidValue


def _known_pattern(text: str) -> str:
    parse_pattern(text)
    return text


#: Largest identifier of 11 bits.
LONGEST_BASE = 0x7FF
CanId = Annotated[int, Field(ge=0, le=0x1FFF_FFFF)]
#: How far identifiers of neighbouring nodes lie apart: 1, or 0x100 where the node is J1939's destination; 0: all alike.
NodeStep = Annotated[int, Field(ge=0, le=0x1_0000)]
Pattern = Annotated[str, AfterValidator(_known_pattern)]


class NodeIdentifiers(StrictModel):
    """Identifiers of requests and answers, of the device with node id `node_of_dbc`; above 0x7FF they have 29 bits."""

    request: CanId
    response: CanId
    request_step: NodeStep = 1
    response_step: NodeStep = 1

    def of_node(self, node: int, node_of_dbc: int) -> tuple[int, int]:
        """Identifiers of a node's requests and answers, with the flag of long ones."""
        away = node - node_of_dbc
        pair = (self.request, self.request_step), (self.response, self.response_step)
        request, response = (base + step * away | (EXTENDED if base > LONGEST_BASE else 0) for base, step in pair)
        return request, response


class UdsSecurity(StrictModel):
    """Security access (0x27). level: of the request for a seed, odd; algorithm: an entry point of the group
    `station.uds_keys`, which makes a key of level and seed."""

    level: Annotated[int, Field(ge=1, le=0x7D)] = 1
    algorithm: Name

    @field_validator("level")
    @classmethod
    def _check_odd(cls, level: int) -> int:
        if level % 2 == 0:
            raise InvalidValue("uds-level-even", level=level)
        return level


class UdsAccess(NodeIdentifiers):
    """UDS (ISO 14229) over ISO-TP.

    The object (index, sub) is the data identifier index + sub; `save` and `restore` are routines of that number.
    byte_order: of numbers; session: the diagnostic session in which objects are written; pending_s: how long a device
    that asks for patience (response pending) may take.
    """

    byte_order: Literal["big", "little"] = "big"

    session: Annotated[int, Field(ge=1, le=0x7E)] = 3
    security: UdsSecurity | None = None
    pending_s: Positive = 5.0


class TemplateExchange(StrictModel):
    """A request, its answer, and what a refusal is, as frame patterns; without `refused` a refusal is silence."""

    send: Pattern
    answer: Pattern
    refused: Pattern | None = None


class TemplateAccess(NodeIdentifiers):
    """A vendor's protocol, such as proprietary PGNs of J1939: one exchange for each thing that is done.

    save, restore: left out where writing their object does it; reset: the device answers, then starts again.
    """

    read: TemplateExchange
    write: TemplateExchange
    reset: TemplateExchange
    save: TemplateExchange | None = None
    restore: TemplateExchange | None = None
