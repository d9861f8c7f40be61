"""How a device keeps one number in an object: REAL32, INT16, Q2.14, ppm32 … Bytes are little-endian (CiA 301)."""

import math
import re
import struct
from dataclasses import dataclass
from functools import cache

from station.errors import InvalidValue

_PLAIN = {
    "BOOLEAN": "<?",
    "INT8": "<b",
    "INT16": "<h",
    "INT32": "<i",
    "INT64": "<q",
    "UINT8": "<B",
    "UINT16": "<H",
    "UINT32": "<I",
    "UINT64": "<Q",
    "REAL32": "<f",
    "REAL64": "<d",
}
_MAX_REAL32 = (2 - 2.0**-23) * 2.0**127
_SIGNED = {8: "<b", 16: "<h", 32: "<i"}
_FIXED_POINT = re.compile(r"^Q(\d{1,2})\.(\d{1,2})$")
_PPM = re.compile(r"^ppm(16|32)$")


@dataclass(frozen=True, slots=True)
class NumberFormat:
    """One format. step: value of one count (0 for floats); from_nominal: keeps the deviation from nominal."""

    name: str
    code: str
    step: float = 1.0
    from_nominal: bool = False

    @property
    def size(self) -> int:
        """Bytes of the object."""
        return struct.calcsize(self.code)

    @property
    def is_float(self) -> bool:
        """REAL32 or REAL64."""
        return self.step == 0.0

    def encode(self, value: float) -> bytes:
        """`value` as the device keeps it, rounded to the nearest number it can keep; InvalidValue when none is near."""
        if not math.isfinite(value):
            raise InvalidValue("number-not-finite")
        try:
            raw = struct.pack(self.code, float(value) if self.is_float else round(value / self.step))
        except (struct.error, OverflowError):
            low, high = self._range()
            raise InvalidValue("number-out-of-range", value=value, format=self.name, low=low, high=high) from None
        return raw

    def decode(self, raw: bytes) -> float:
        """The number that these bytes mean; InvalidValue when their count is not the format's."""
        if len(raw) != self.size:
            raise InvalidValue("number-wrong-size", format=self.name, size=self.size, count=len(raw))
        (stored,) = struct.unpack(self.code, raw)
        return float(stored) if self.is_float else float(stored) * self.step

    def spacing(self, value: float) -> float:
        """Distance between neighbouring numbers of the format about `value`."""
        if self.step:
            return self.step
        return math.ulp(value) if self.code == "<d" else _ulp32(value)

    def _range(self) -> tuple[float, float]:
        if self.is_float:
            return -_MAX_REAL32, _MAX_REAL32  # only REAL32 can overflow
        bits = 8 * self.size
        low, high = (0, 2**bits - 1) if self.code.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        return low * self.step, high * self.step


@cache
def parse(name: str) -> NumberFormat:
    """The format of that name; InvalidValue lists the known ones.

    Qm.n is signed fixed point with n bits after the point; m counts the sign bit (ARM) where m + n is 8, 16 or
    32, and does not (Texas Instruments) where m + n + 1 is. ppm16, ppm32: millionths of the deviation from nominal.
    """
    plain = re.sub(r"^UNSIGNED", "UINT", re.sub(r"^INTEGER", "INT", name))
    if plain in _PLAIN:
        return NumberFormat(plain, _PLAIN[plain], 0.0 if plain.startswith("REAL") else 1.0)
    if match := _FIXED_POINT.match(name):
        whole, fraction = int(match[1]), int(match[2])
        for bits in (whole + fraction, whole + fraction + 1):
            if bits in _SIGNED:
                return NumberFormat(name, _SIGNED[bits], 2.0**-fraction)
    if match := _PPM.match(name):
        return NumberFormat(name, _SIGNED[int(match[1])], 1e-6, from_nominal=True)
    raise InvalidValue("number-format-unknown", format=name, known=tuple(_PLAIN))


def _ulp32(value: float) -> float:
    """Unit in the last place of a REAL32 (IEEE 754: 24 bits of significand, least exponent −126)."""
    exponent = math.frexp(value)[1] if value else -125
    return float(2.0 ** (max(exponent, -125) - 24))
