"""Sentences, commands and tables laid out for a width; pure. width: characters of a line, None where nobody counts."""

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

#: A column of words is not made narrower than this.
LEAST_WORDS = 24
#: What the continuation of a row, or of a sentence, is indented by.
INDENT = 2


def printable_text(text: str) -> str:
    """The text with nothing in it that could steer a terminal: names come from files and devices."""
    return "".join(c if c.isprintable() else " " for c in text)


def sentence_lines(text: str, width: int | None) -> list[str]:
    """A sentence broken between words, its continuation indented; a word that is too long stays whole."""
    if width is None or len(text) <= width:
        return [text]
    indent = " " * (len(text) - len(text.lstrip()) + INDENT)
    return textwrap.wrap(text, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def command_lines(text: str, width: int | None) -> list[str]:
    """A command to paste: broken lines end in a backslash."""
    lines = sentence_lines(text, None if width is None else width - len(" \\"))
    return [*(f"{line} \\" for line in lines[:-1]), lines[-1]]


@dataclass(frozen=True, slots=True)
class TextTable:
    """A table as text. right: columns of numbers; words: columns that may be broken between words; rule: a line under
    the heads."""

    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    right: frozenset[int] = frozenset()
    words: frozenset[int] = frozenset()
    rule: bool = True
    indent: int = 0

    def lines(self, width: int | None) -> Iterator[str]:
        """Heads are broken between words before a row goes on in the next line: no digit is cut off."""
        widths = self._fitted(width)
        gap = 2 if width is None or self._total(widths, 2) <= width else 1
        parts = self._parts(widths, gap, width)
        yield from self._row(self.heads, parts, widths, gap, heads=True)
        if self.rule:
            yield " " * self.indent + "─" * max(sum(widths[i] + gap for i in part) - gap for part in parts)
        for row in self.rows:
            yield from self._row(row, parts, widths, gap)

    def _total(self, widths: Sequence[int], gap: int) -> int:
        return self.indent + sum(widths) + gap * (len(widths) - 1)

    def _fitted(self, width: int | None) -> list[int]:
        """The width of each column: of its widest cell, where that fits."""
        cells = [max(map(len, column), default=0) for column in zip(*self.rows, strict=True)] or [0] * len(self.heads)
        widths = [max(len(head), cell) for head, cell in zip(self.heads, cells, strict=True)]
        if width is None or self._total(widths, 1) <= width:
            return widths
        least = [max(map(len, head.split()), default=0) for head in self.heads]
        widths = [max(*both) for both in zip(least, cells, strict=True)]
        rest = self._total(widths[1:], 1) + INDENT
        if not self.words and self._total(widths, 1) > width >= rest:
            return [widths[0], *self._roomier(widths, width + widths[0] - INDENT + 1)[1:]]
        spare = width - self._total([w for i, w in enumerate(widths) if i not in self.words], 1)
        share = spare // max(len(self.words), 1) - 1
        if share < LEAST_WORDS:  # words get a line of their own
            share = max(LEAST_WORDS, width - self.indent - INDENT)
        return self._roomier([min(w, share) if i in self.words else w for i, w in enumerate(widths)], width)

    def _roomier(self, widths: list[int], width: int) -> list[int]:
        """What is spare goes, character by character, to the head of the most lines."""
        for _ in range(width - self._total(widths, 1)):
            heights = [len(self._cell(head, w, broken=True)) for head, w in zip(self.heads, widths, strict=True)]
            if max(heights) == 1:
                break
            widths[heights.index(max(heights))] += 1
        return widths

    def _parts(self, widths: list[int], gap: int, width: int | None) -> list[list[int]]:
        """Columns line by line."""
        rest = self.indent + INDENT + sum(widths[1:]) + gap * (len(widths) - 2)
        if width is not None and self._total(widths, gap) > width >= rest:
            # A long name gets a line of its own, and the rest of its row stays one line.
            return [[0], list(range(1, len(widths)))]
        parts, used = [[0]], self.indent + widths[0]
        for i in range(1, len(widths)):
            if width is not None and used + gap + widths[i] > width:
                parts.append([])
                used = self.indent + INDENT - gap
            parts[-1].append(i)
            used += gap + widths[i]
        return parts

    def _row(
        self,
        row: Sequence[str],
        parts: Sequence[Sequence[int]],
        widths: Sequence[int],
        gap: int,
        *,
        heads: bool = False,
    ) -> Iterator[str]:
        for number, part in enumerate(parts):
            indent = " " * (self.indent + (INDENT if number else 0))
            cells = [self._cell(row[i], widths[i], broken=heads or i in self.words) for i in part]
            height = max(map(len, cells))
            for line in range(height):
                # Heads stand on their rule.
                texts = [_line_of(cell, line - (height - len(cell) if heads else 0)) for cell in cells]
                padded = (
                    text.rjust(widths[i]) if i in self.right else text.ljust(widths[i])
                    for i, text in zip(part, texts, strict=True)
                )
                if any(texts):
                    yield (indent + (" " * gap).join(padded)).rstrip()

    @staticmethod
    def _cell(text: str, width: int, *, broken: bool) -> list[str]:
        if not broken or len(text) <= width:
            return [text]
        return textwrap.wrap(text, width, break_long_words=False, break_on_hyphens=False)


def _line_of(cell: Sequence[str], line: int) -> str:
    return cell[line] if 0 <= line < len(cell) else ""
