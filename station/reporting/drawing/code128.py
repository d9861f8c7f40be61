"""Code 128 (ISO/IEC 15417), code set B: a short text as bars that every scanner reads."""

from html import escape

#: Widths of bar, space, bar, space, bar, space of the 106 symbols, and of the stop pattern (ISO/IEC 15417, table 1).
_TABLE = """
212222 222122 222221 121223 121322 131222 122213 122312 132212 221213 221312 231212 112232 122132 122231 113222
123122 123221 223211 221132 221231 213212 223112 312131 311222 321122 321221 312212 322112 322211 212123 212321
232121 111323 131123 131321 112313 132113 132311 211313 231113 231311 112133 112331 132131 113123 113321 133121
313121 211331 231131 213113 213311 213131 311123 311321 331121 312113 312311 332111 314111 221411 431111 111224
111422 121124 121421 141122 141221 112214 112412 122114 122411 142112 142211 241211 221114 413111 241112 134111
111242 121142 121241 114212 124112 124211 411212 421112 421211 212141 214121 412121 111143 111341 131141 114113
114311 411113 411311 113141 114131 311141 411131 211412 211214 211232 2331112
"""
_WIDTHS = tuple(_TABLE.split())
_START_B, _STOP, _MODULUS = 104, 106, 103
_QUIET = 10


def symbols(text: str) -> list[int]:
    """Start, the text's symbols, check symbol and stop. ValueError where a character is not of code set B."""
    values = [ord(c) - 32 for c in text]
    if not all(0 <= v < 95 for v in values):
        raise ValueError("code set B holds the printable ASCII characters only")
    check = (_START_B + sum(i * v for i, v in enumerate(values, 1))) % _MODULUS
    return [_START_B, *values, check, _STOP]


def code128(text: str, height: int = 40) -> str:
    """SVG of the bars, one unit a module, with the quiet zone that the standard wants."""
    bars, at = [], _QUIET
    for symbol in symbols(text):
        for i, width in enumerate(map(int, _WIDTHS[symbol])):
            if i % 2 == 0:
                bars.append(f"M{at} 0h{width}v{height}h-{width}z")
            at += width
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {at + _QUIET} {height}" role="img" '
        f'preserveAspectRatio="none"><title>{escape(text)}</title><path fill="#000" d="{"".join(bars)}"/></svg>'
    )
