"""What is handed to the log as the columns of its tables."""

import dataclasses

from station.domain.records import plain_json
from station.domain.records.chain import Value
from station.domain.records.framepack.plain import PlainFrames
from station.ports.store import AttemptStart, VisitRecord


def columns(begin: AttemptStart, attempt: str, recipe: int | None, product: int | None) -> dict[str, Value]:
    """The attempt's columns by name: what its start says, and the record numbers of recipe and product."""
    values = {f.name: getattr(begin, f.name) for f in dataclasses.fields(begin)}
    cleaned = {name: plain_json.text(value) if isinstance(value, str) else value for name, value in values.items()}
    return {**cleaned, "id": attempt, "recipe": recipe, "product": product}


def visit(record: VisitRecord, packed: PlainFrames) -> tuple[Value, ...]:
    """The visit's columns after `attempt`; packed: its frames as plain bytes."""
    return (
        *(
            record.run,
            record.visit,
            plain_json.text(record.position),
            plain_json.text(record.seating),
            plain_json.text(record.kind),
        ),
        *(record.arrived_ns, record.left_ns, packed.count, packed.sha256, plain_json.document(record.statistics)),
    )
