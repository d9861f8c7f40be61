"""A product file `dbc/<name>.yaml` (schema `station.product/1`): its frames, its identity and its device map."""

from typing import Annotated, Literal

from pydantic import Field

from station import plugins
from station.domain.can.sensor_layout import FrameMap
from station.domain.core.patterns import groups_of
from station.domain.product.device_map import DeviceMap, SerialObject
from station.domain.recipe import sensor as sensor_kind
from station.domain.recipe.fields import Name, StrictModel, one_of
from station.errors import UsageError
from station.messages import Message

Word = Annotated[int, Field(ge=0, le=0xFFFF_FFFF)]


class ProductIdentity(StrictModel):
    """What the identity objects must read; what is left out is not asked.

    device_type: 0x1000; vendor, product, revision: 0x1018:1–3; name: 0x1008.
    """

    vendor: Word | None = None
    product: Word | None = None
    device_type: Word | None = None
    revision_at_least: Word | None = None
    name: str | None = None

    @property
    def objects(self) -> dict[tuple[int, int], int | str]:
        """What each object must read, at least for the revision."""
        places = {
            (0x1000, 0): self.device_type,
            (0x1018, 1): self.vendor,
            (0x1018, 2): self.product,
            (0x1018, 3): self.revision_at_least,
            (0x1008, 0): self.name,
        }
        return {at: wanted for at, wanted in places.items() if wanted is not None}

    @property
    def required(self) -> frozenset[tuple[int, int]]:
        """Objects without which nothing can be said."""
        return frozenset(self.objects)


class Product(StrictModel):
    """Everything about a product that no recipe and no config holds. eds: file beside the product file."""

    schema_: Annotated[Literal["station.product/1"], Field(alias="schema")]
    name: Name
    sensor: Annotated[str, one_of(lambda: plugins.names(sensor_kind.PACKAGE))]
    eds: Name | None = None
    frames: FrameMap
    identity: ProductIdentity = ProductIdentity()
    map: DeviceMap = DeviceMap()

    def mismatches(
        self, *, device_type: int, vendor: int, product: int, revision: int, name: str
    ) -> tuple[Message, ...]:
        """How a device's identity objects differ from this product's; nothing when it is one."""
        wanted = self.identity
        numbers = (
            ("vendor-differs", vendor, wanted.vendor),
            ("product-code-differs", product, wanted.product),
            ("device-type-differs", device_type, wanted.device_type),
        )
        found = [Message(id_, read=read, expected=want) for id_, read, want in numbers if want not in (None, read)]
        if wanted.revision_at_least is not None and revision < wanted.revision_at_least:
            found.append(Message("revision-too-old", read=revision, least=wanted.revision_at_least))
        if wanted.name is not None and name != wanted.name:
            found.append(Message("name-differs", read=name, expected=wanted.name))
        return tuple(found)


def serial_of(device_map: DeviceMap, printed: str) -> int | str:
    """What a device with this printed serial keeps; the printed one where it keeps none."""
    place = device_map.serial_object
    return printed if place is None else stored_serial(place, printed)


def stored_serial(serial: SerialObject, printed: str) -> int | str:
    """What a device with this printed serial must keep (SN0042 → 42); UsageError when it follows another pattern."""
    groups = groups_of(serial.printed, printed)
    if groups is None or groups[0] is None:
        raise UsageError("serial-not-of-product", serial=printed[:40], pattern=serial.printed)
    return int(groups[0]) if serial.kind == "number" else groups[0]


def decode_serial(serial: SerialObject, raw: bytes) -> int | str:
    """The serial in the bytes of the serial object."""
    if serial.kind == "number":
        return int.from_bytes(raw, "little")
    return raw.decode("latin-1").rstrip("\0")
