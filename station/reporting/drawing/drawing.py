"""A drawing that fits its paper: wide as it was made, or narrow for a phone."""

from collections.abc import Callable
from dataclasses import dataclass

#: A phone's column, px.
NARROW_PX = 350.0


@dataclass(frozen=True, slots=True)
class Drawing:
    """draw: the SVG at a width, px; width_px: the one it is made for."""

    draw: Callable[[float], str]
    width_px: float

    def __str__(self) -> str:
        return self.draw(self.width_px)

    def narrow(self) -> str:
        """The same for a phone: lines and marks closer together, letters as large as before."""
        return self.draw(min(NARROW_PX, self.width_px))
