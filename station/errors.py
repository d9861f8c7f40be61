"""The tree of errors. The type says whom to blame; the message is one sentence for a person.

StationError
├── InputError            exit 2   what a person handed in is wrong
│   ├── UsageError                 the command line
│   ├── RecipeError                recipes/*.yaml
│   ├── ConfigError                config.yaml
│   ├── ProductError               dbc/*.yaml, *.dbc, *.eds: frames and device map
│   ├── SamplesError               a samples table
│   ├── LogError                   a CAN log or a station log that cannot be read
│   └── InvalidValue               one value in a document, raised in a schema's validator
├── UnitFault             exit 1   the unit: outcome FAIL
│   ├── WrongProduct               it is not what the recipe is for
│   ├── DeviceRefused              an SDO abort code
│   └── ReadBackDiffers            it keeps something else than was written
├── StationFault          exit 3   the station: outcome ERROR
│   ├── BusFault                   interface down, bus-off, no buffer
│   │   └── NodeShared             two devices answer under one node id
│   ├── DeviceSilent               no answer within its time-out
│   ├── WrongUnit                  another unit sits in the nest than was said
│   ├── ForeignMaster              somebody else commands the unit's device meanwhile
│   ├── DeviceChanged              the device is no longer what was verified
│   ├── PositionerFault            stuck, late, at the wrong place
│   ├── PlcFault                   a PLC that is silent, stale or speaks another protocol
│   ├── StoreFault                 the record cannot be written
│   └── ReferenceOverdue           a gold reference or golden unit past its due date
└── Aborted               exit 4   the operator: outcome ABORTED
"""

from collections.abc import Iterator
from contextlib import contextmanager

from station.messages import Message, Value, render

#: Parameters by which a message says where it found what it tells.
_PLACES = ("file", "place")


class StationError(Exception):
    """Root of every error this project raises on purpose: `RecipeError("recipe-name-twice", name="z-up", line=12)`.

    What it says is a message of the catalogues (station.messages); text with blanks in it is taken as it stands.
    """

    exit_code = 70
    outcome = "ERROR"

    def __init__(self, id: str | Message, /, **parameters: Value) -> None:  # noqa: A002 - the word of the format
        if isinstance(id, Message):
            self.message = id
        else:
            self.message = Message.text(id) if " " in id else Message(id, **parameters)
        super().__init__(self.message)

    @property
    def sentence(self) -> str:
        """What happened and what to do, in English."""
        return render(self.message)

    def __str__(self) -> str:
        return self.sentence


class InputError(StationError):
    """What a person handed in is wrong; the sentence names file, line, key and remedy."""

    exit_code = 2


class UsageError(InputError):
    """The command line asks for something that cannot be."""


class RecipeError(InputError):
    """A recipe that cannot be run."""


class ConfigError(InputError):
    """A config.yaml that cannot be used."""


class ProductError(InputError):
    """A product's DBC, EDS or device map that cannot be used."""


class SamplesError(InputError):
    """A samples table that cannot be used."""


@contextmanager
def naming_file(source: object) -> Iterator[None]:
    """What computes knows no files: errors raised in this block about samples say that they are of this file or log."""
    try:
        yield
    except SamplesError as error:
        if any(name in error.message.parameters for name in _PLACES):
            raise
        raise SamplesError("file-reason", file=str(source), reason=error.message) from None


class LogError(InputError):
    """A CAN log or station log that cannot be read."""


class InvalidValue(InputError, ValueError):
    """A value that a schema refuses, raised in its validator: pydantic takes it for a ValueError.

    The sentence names the value and the remedy; file, line and key are added where the document is read. below: the key
    that is wrong, from the block whose validator raises it.
    """

    def __init__(self, id: str | Message, /, *, below: tuple[str | int, ...] = (), **parameters: Value) -> None:  # noqa: A002
        super().__init__(id, **parameters)
        self.below = below


class UnitFault(StationError):
    """The unit is at fault: outcome FAIL."""

    exit_code = 1
    outcome = "FAIL"


class WrongProduct(UnitFault):
    """The device on the bus is not what the recipe is for."""


class DeviceRefused(UnitFault):
    """The device answered with an SDO abort code."""

    def __init__(self, id: str | Message, /, *, code: int, **parameters: Value) -> None:  # noqa: A002
        super().__init__(id, **parameters)
        self.code = code

    def __reduce__(self) -> tuple[object, ...]:
        return _again, (type(self), self.message, self.code)


class ReadBackDiffers(UnitFault):
    """The device holds another value than the one written."""


class StationFault(StationError):
    """The station is at fault: outcome ERROR."""

    exit_code = 3


class BusFault(StationFault):
    """The bus or its interface failed."""


class NodeShared(BusFault):
    """Two devices answer under one node id: the others on the bus are none the worse for it."""


class DeviceSilent(StationFault):
    """The device did not answer within its time-out."""


class WrongUnit(StationFault):
    """Another unit sits in the nest than the one that was scanned or measured."""


class ForeignMaster(StationFault):
    """Somebody else writes to the unit's device, or switches it, while the station works on it."""


class DeviceChanged(StationFault):
    """The device is no longer what was verified."""


class PositionerFault(StationFault):
    """The positioner is stuck, late or at the wrong place."""


class PlcFault(StationFault):
    """A PLC is silent, its heartbeat stands, or it speaks another protocol."""


class StoreFault(StationFault):
    """The record cannot be written, so nothing may be passed."""


class ReferenceOverdue(StationFault):
    """A gold reference or golden-unit check is past its due date."""


class Aborted(StationError):
    """The operator stopped the run."""

    exit_code = 4
    outcome = "ABORTED"


def _again(kind: type[DeviceRefused], message: Message, code: int) -> DeviceRefused:
    return kind(message, code=code)
