"""`line:` of config.yaml: the cell around the station, its scanner, its printer, and how shifts go."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from station.domain.cell.symbol_content import ContentRules
from station.domain.recipe.fields import Name, NotNegative, Positive, StrictModel

Port = Annotated[int, Field(ge=1, le=65535)]
Host = Annotated[str, Field(max_length=253, pattern=r"^[\w.:\-]*$")]


class LineAdapterSettings(BaseModel):
    """A block whose other keys are the options of the adapter that it names, checked by it."""

    model_config = ConfigDict(frozen=True, extra="allow")
    kind: Name

    @property
    def options(self) -> dict[str, Any]:
        """The adapter's own keys."""
        return dict(self.model_extra or {})


class ServedSettings(StrictModel):
    """Where the station's outer state is served."""

    host: Host = "127.0.0.1"
    port: Port


class LineSettings(StrictModel):
    """cell, scanner: adapters by file name; label: what a label holds; printer: of labels, None for none.

    after_crash: `wait` for a person's clear, or `continue`; start: `auto`, or on the command of a line controller;
    starved_s: so long without a load is starved; lost_s: so long may the cell be silent; scan_s: longest for one label;
    shift_h, shift_begins_h: length and beginning of shifts, hours UTC; ideal_s: time of a unit at
    best, for performance.
    """

    cell: LineAdapterSettings = LineAdapterSettings(kind="plc")
    scanner: LineAdapterSettings = LineAdapterSettings(kind="keyboard")
    label: ContentRules = ContentRules()
    printer: LineAdapterSettings | None = None
    after_crash: Literal["wait", "continue"] = "wait"
    start: Literal["auto", "command"] = "auto"
    starved_s: NotNegative = 5.0
    lost_s: NotNegative = 2.0
    scan_s: Positive = 5.0
    shift_h: Annotated[float, Field(gt=0, le=24)] = 8.0
    shift_begins_h: Annotated[float, Field(ge=0, lt=24)] = 6.0
    ideal_s: NotNegative = 0.0
    opcua: ServedSettings | None = None
    modbus: ServedSettings | None = None
