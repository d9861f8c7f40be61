"""The certificate as PDF: the same sections, laid out by reportlab."""

from html import escape
from io import BytesIO

from station.web.certificate import Certificate, Section

_WIDTH = 482.0


def pdf(certificate: Certificate) -> bytes:
    """One document, A4."""
    from reportlab.lib.pagesizes import A4
    from reportlab.lib.styles import getSampleStyleSheet
    from reportlab.platypus import Paragraph, SimpleDocTemplate, Spacer

    styles = getSampleStyleSheet()
    parts = [Paragraph(_text(f"Calibration certificate {certificate.serial}: {certificate.outcome}"), styles["Title"])]
    for section in certificate.sections:
        parts += [Paragraph(_text(section.title), styles["Heading3"]), _table(section), Spacer(1, 6)]
    paper = BytesIO()
    title = _plain(f"Calibration certificate {certificate.serial}")
    SimpleDocTemplate(paper, pagesize=A4, margins=36, title=title, topMargin=40, bottomMargin=40).build(parts)
    return paper.getvalue()


def _table(section: Section) -> object:
    from reportlab.lib import colors
    from reportlab.lib.styles import getSampleStyleSheet
    from reportlab.platypus import Paragraph, Table

    small = getSampleStyleSheet()["BodyText"].clone("small", fontSize=8, leading=10, splitLongWords=True)
    rows = [section.columns, *section.rows] if any(section.columns) else list(section.rows)
    count = len(section.columns)
    widths = [150.0, _WIDTH - 150.0] if count == 2 else [_WIDTH / count] * count
    cells = [[Paragraph(_text(cell), small) for cell in row] for row in rows]
    grid = [("GRID", (0, 0), (-1, -1), 0.4, colors.grey), ("VALIGN", (0, 0), (-1, -1), "TOP")]
    return Table(cells, colWidths=widths, style=grid)


def _text(words: str) -> str:
    return escape(_plain(words))


def _plain(words: str) -> str:
    """What the PDF's built-in fonts can show."""
    known = words.translate({0x2212: "-", 0x2013: "-", 0x00B7: "·"})
    return known.encode("cp1252", "replace").decode("cp1252")
