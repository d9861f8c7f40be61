"""Fonts of a certificate's PDF, and which of them shows which character.

FiraGO stands in the file itself, as far as it is used: Latin of every language, Greek, Cyrillic. What it has no glyph
for is shown by the reader's Chinese or Korean font.
"""

import unicodedata
from collections.abc import Iterator
from functools import lru_cache
from io import BytesIO
from itertools import groupby

REGULAR, BOLD = "FiraGO", "FiraGO-Bold"
#: The reader's own fonts, each with an encoding of the characters that it has.
_READERS = (("STSong-Light", "gbk"), ("HYSMyeongJo-Medium", "cp949"))


def runs(words: str, font: str) -> Iterator[tuple[str, str]]:
    """Words as stretches, each with the name of a font that has its characters; what cannot be printed is a blank."""
    known = known_characters()
    shown = "".join(c if c.isprintable() else " " for c in unicodedata.normalize("NFC", words))
    for name, run in groupby(shown, lambda c: font if ord(c) in known else _reader_font(c, font)):
        yield name, "".join(run)


@lru_cache(maxsize=1)
def known_characters() -> frozenset[int]:
    """Registers the fonts with reportlab; the characters that the file's own one has."""
    from pymupdf_fonts import FiraGO_Bold, FiraGO_Regular
    from reportlab.pdfbase import pdfmetrics
    from reportlab.pdfbase.cidfonts import UnicodeCIDFont
    from reportlab.pdfbase.ttfonts import TTFont

    regular = TTFont(REGULAR, BytesIO(FiraGO_Regular.fontbuffer))
    bold = TTFont(BOLD, BytesIO(FiraGO_Bold.fontbuffer))
    for font in (regular, bold, *(UnicodeCIDFont(name) for name, _ in _READERS)):
        pdfmetrics.registerFont(font)
    return frozenset(regular.face.charToGlyph) & frozenset(bold.face.charToGlyph)


def _reader_font(character: str, otherwise: str) -> str:
    for name, encoding in _READERS:
        try:
            character.encode(encoding)
        except UnicodeEncodeError:
            continue
        return name
    return otherwise
