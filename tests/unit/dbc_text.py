"""Random DBC texts for tests: little and big endian, signed, floats, two levels of multiplexing."""

from dataclasses import dataclass, field
from pathlib import Path

from hypothesis import strategies as st

from station.adapters.dbc import read_layouts
from station.domain.can.signals import FrameLayout

HEAD = 'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: A\n\n'
SCALES = ("1", "2", "-3", "0.5", "1E-3", "6.25E-005", "1e10", "0.1", "1000000007", "1.0")
OFFSETS = ("0", "-40", "273.15", "1577840400", "-64", "1e-7", "0.0")


@dataclass
class Text:
    """Lines of one message in the making."""

    frame_id: int
    length: int
    signals: list[str] = field(default_factory=list)
    floats: list[str] = field(default_factory=list)
    muxes: list[str] = field(default_factory=list)

    def dbc(self) -> str:
        """The whole file."""
        head = f"BO_ {self.frame_id} RANDOM: {self.length} A\n"
        return HEAD + head + "".join(s + "\n" for s in [*self.signals, "", *self.floats, *self.muxes])

    def layout(self, folder: Path) -> FrameLayout:
        """The message as the station reads it from a file."""
        path = folder / "random.dbc"
        path.write_text(self.dbc())
        return read_layouts(path)["RANDOM"]


def at(position: int, length: int, big: bool) -> str:
    """start|length@order for a signal whose first bit in its own bit order is `position`."""
    start = 8 * (position // 8) + 7 - position % 8 if big else position
    return f"{start}|{length}@{0 if big else 1}"


@st.composite
def messages(draw: st.DrawFn, multiplexed: bool = False, longest: int = 8) -> Text:
    """One message; its payload is cut into byte-aligned groups of either byte order."""
    extended = draw(st.booleans())
    frame_id = draw(st.integers(0, 0x1FFF_FFFF)) | 0x8000_0000 if extended else draw(st.integers(0, 0x7FF))
    text = Text(frame_id, draw(st.integers(3 if multiplexed else 1, longest)))
    if not multiplexed:
        _fill(draw, text, first=0, prefix="S")
        return text
    text.signals.append(f' SG_ M M : {at(0, 8, False)}+ (1,0) [0|0] "" A')
    inner = draw(st.sampled_from([7, 200]))
    # What hangs on the inner selector lies in the same bytes: no other signal may be there with it.
    for value in draw(st.sets(st.integers(0, 255).filter(lambda v: v != inner), min_size=1, max_size=3)):
        _fill(draw, text, first=2, prefix=f"P{value}_", mux=f"m{value} ")
    text.signals.append(f' SG_ N m{inner}M : {at(8, 4, True)}+ (1,0) [0|0] "" A')
    text.muxes.append(f"SG_MUL_VAL_ {text.frame_id} N M {inner}-{inner};")
    _fill(draw, text, first=2, prefix="Q", mux="m3 ")
    for line in [s.split()[1] for s in text.signals if s.split()[1].startswith("Q")]:
        text.muxes.append(f"SG_MUL_VAL_ {text.frame_id} {line} N 3-3, 5-9;")
    for words in [s.split() for s in text.signals if s.split()[1].startswith("P")]:
        outer = words[2][1:]
        text.muxes.append(f"SG_MUL_VAL_ {text.frame_id} {words[1]} M {outer}-{outer};")
    return text


def _fill(draw: st.DrawFn, text: Text, *, first: int, prefix: str, mux: str = "") -> None:
    """Signals in the bytes from `first`."""
    while first < text.length:
        size, big = draw(st.integers(1, text.length - first)), draw(st.booleans())
        position, end = 8 * first, 8 * (first + size)
        while position < end:
            length = draw(st.integers(1, min(64, end - position)))
            if draw(st.integers(0, 9)):
                place = at(position, length, big)
                _signal(draw, text, f"{prefix}{len(text.signals)}", f"{mux}: {place}", length)
            position += length
        first += size


def _signal(draw: st.DrawFn, text: Text, name: str, place: str, length: int) -> None:
    sign = draw(st.sampled_from("+-"))
    if length in (32, 64) and draw(st.booleans()):
        text.floats.append(f"SIG_VALTYPE_ {text.frame_id} {name} : {1 if length == 32 else 2};")
    scale, offset = draw(st.sampled_from(SCALES)), draw(st.sampled_from(OFFSETS))
    text.signals.append(f' SG_ {name} {place}{sign} ({scale},{offset}) [0|0] "" A')
