"""The certificate as PDF: the same sections, laid out by reportlab; every page names its unit and its number."""

from collections.abc import Sequence
from html import escape
from io import BytesIO
from typing import Any

from station.reporting.certificate.document import Certificate
from station.reporting.certificate.fonts import BOLD, REGULAR, known_characters, runs
from station.reporting.certificate.writer import CertificateTable

#: Of a table; of its cells the size of letters and the room beside the text, in points.
_WIDTH, _CELL, _PADDING = 511.0, 8, 6
#: Widths of a table's columns, by how many it has.
_SHARES = {
    2: (0.33, 0.67),
    3: (0.3, 0.15, 0.55),
    7: (0.235, 0.125, 0.14, 0.107, 0.13, 0.125, 0.138),
    4: (0.28, 0.24, 0.24, 0.24),
    5: (0.28, 0.2, 0.2, 0.2, 0.12),
}
#: The first column of any other table, which names its rows.
_FIRST = 0.24
#: Tables of so many rows stand on one page; longer ones begin where so much of it is left, in points.
_TOGETHER, _LEAST = 8, 150.0
_COLOURS = {"PASS": "#0a6132", "FAIL": "#a8001c"}


def pdf(certificate: Certificate) -> bytes:
    """One document, A4."""
    from reportlab.lib.pagesizes import A4
    from reportlab.platypus import CondPageBreak, KeepTogether, Paragraph, SimpleDocTemplate, Spacer

    wrap = "CJK" if certificate.language == "zh" else "LTR"
    title, head, cell = (_style(size, bold, wrap) for size, bold in ((17, True), (10.5, True), (_CELL, False)))
    outcome = certificate.texts[certificate.outcome]
    colour = _COLOURS.get(certificate.outcome, "#000000")
    verdict = f'<font color="{colour}">{_text(outcome, BOLD)}</font>'
    parts: list[Any] = [Paragraph(f"{_text(certificate.title, BOLD)}: {verdict}", title), Spacer(1, 8)]
    for section in certificate.sections:
        heading = Paragraph(_text(section.title, BOLD), head)
        table = _table(section, cell)
        whole = len(section.rows) <= _TOGETHER
        parts += [KeepTogether([heading, table])] if whole else [CondPageBreak(_LEAST), heading, table]
        parts.append(Spacer(1, 7))
    parts.append(KeepTogether([Paragraph(_text(words, REGULAR), cell) for words in certificate.statements]))
    paper = BytesIO()
    SimpleDocTemplate(
        paper, pagesize=A4, leftMargin=42, rightMargin=42, topMargin=40, bottomMargin=46,
        title=certificate.title, lang=certificate.language, keywords=certificate.mark, invariant=True,
    ).build(parts, canvasmaker=_numbered(certificate))  # fmt: skip
    return paper.getvalue()


def _table(section: CertificateTable, cell: Any) -> Any:
    from reportlab.lib import colors
    from reportlab.platypus import Paragraph, Table

    rows = [section.columns, *section.rows] if any(section.columns) else list(section.rows)
    rooms = column_widths(len(rows[0]))
    widths = [room + 2 * _PADDING for room in rooms]
    cells = [[Paragraph(_text(words, REGULAR), cell) for words in row] for row in rows]
    if any(section.columns) and cell.wordWrap != "CJK" and (size := head_size(section.columns, rooms)) < _CELL:
        head = _style(size, bold=False, wrap=cell.wordWrap)
        cells[0] = [Paragraph(_text(words, REGULAR), head) for words in section.columns]
    style: list[Any] = [("GRID", (0, 0), (-1, -1), 0.4, colors.grey), ("VALIGN", (0, 0), (-1, -1), "TOP")]
    style += [("TOPPADDING", (0, 0), (-1, -1), 2), ("BOTTOMPADDING", (0, 0), (-1, -1), 2.5)]
    shaded = ((0, 0), (-1, 0)) if any(section.columns) else ((0, 0), (0, -1))
    style += [("BACKGROUND", *shaded, colors.HexColor("#e6e9ee"))]
    return Table(cells, colWidths=widths, style=style, repeatRows=int(any(section.columns)))


def column_widths(count: int) -> list[float]:
    """What there is for text in each column of a table of so many, in points."""
    others = (1 - _FIRST) / max(count - 1, 1)
    return [_WIDTH * share - 2 * _PADDING for share in _SHARES.get(count, (_FIRST, *(others,) * (count - 1)))]


def head_size(heads: Sequence[str], rooms: Sequence[float]) -> float:
    """Size of letters, in points, in which no word of a table's heads is broken; that of cells at most."""
    needed = (cell_text_width(word) / room for head, room in zip(heads, rooms, strict=True) for word in head.split())
    return _CELL / max(max(needed, default=1.0), 1.0)


def cell_text_width(words: str) -> float:
    """Of words in a table's cell, in points."""
    from reportlab.pdfbase.pdfmetrics import stringWidth

    known_characters()
    return float(stringWidth(words, REGULAR, _CELL))


def _style(size: float, bold: bool, wrap: str) -> Any:
    from reportlab.lib.styles import ParagraphStyle

    known_characters()
    font = BOLD if bold else REGULAR
    return ParagraphStyle(
        f"s{size}", fontName=font, fontSize=size, leading=size * 1.3, spaceAfter=3, wordWrap=wrap, splitLongWords=1
    )


def _text(words: str, font: str) -> str:
    """Words as reportlab's markup: each stretch in a font that has its characters."""
    return "".join(f'<font name="{name}">{escape(run)}</font>' for name, run in runs(words, font))


def _numbered(certificate: Certificate) -> type[Any]:
    """A canvas that writes at the foot of every page whose certificate it is and which page of how many."""
    from reportlab.pdfgen.canvas import Canvas

    class Numbered(Canvas):  # type: ignore[misc]
        """Holds the pages back until their number is known."""

        def __init__(self, *args: Any, **options: Any) -> None:
            super().__init__(*args, **options)
            self._pages: list[dict[str, Any]] = []

        def showPage(self) -> None:
            """Keeps the page."""
            self._pages.append(dict(self.__dict__))
            self._startPage()

        def save(self) -> None:
            """Writes every page with its foot."""
            for number, page in enumerate(self._pages, 1):
                self.__dict__.update(page)
                place = certificate.texts["cert_page"].format(number, len(self._pages))
                if certificate.simulated:
                    self._mark(certificate.simulated)
                self._foot(f"{certificate.serial} · {certificate.number} · {place}")
                super().showPage()
            super().save()

        def _mark(self, words: str) -> None:
            """Across the page, grey."""
            self.saveState()
            self.setFillGray(0.82, 0.5)
            self.translate(297, 421)
            self.rotate(55)
            self.setFont(next(name for name, _ in runs(words, BOLD)), 86)
            self.drawCentredString(0, -30, words)
            self.restoreState()

        def _foot(self, words: str) -> None:
            line = self.beginText(42, 26)
            for name, run in runs(words, REGULAR):
                line.setFont(name, 7)
                line.textOut(run)
            self.drawText(line)

    return Numbered
