"""A reading that is spoken over several lines, always in one order: a line for each reading."""

from collections import Counter
from collections.abc import Callable

from station.adapters.recordings import dialect

#: Lines of one reading, at most; of the lines at least this share come in their order, in so many readings.
MOST_LINES, REGULAR, LEAST_READINGS = 12, 0.95, 20
BETWEEN = " | "


def whole_records(lines: list[str], pattern: Callable[[str], str], begins: str) -> list[str] | None:
    """The lines of each reading as one; None where no order of lines comes again and again. pattern: what lines of one
    kind have in common; begins: what stands in the pattern of the line by which a reading begins, if any has it."""
    filled = [line for line in lines if line.strip()]
    middle = [pattern(line) for line in filled[len(filled) // 2 :][: dialect.HEAD]]
    order = _order(middle)
    if order is None or _are_even(filled):
        return None
    first = next((i for i, kind in enumerate(order) if begins in kind), order.index(_first_of(filled, order, pattern)))
    order = order[first:] + order[:first]
    found: list[str] = []
    part: list[str] = []
    for line in filled:
        kind = pattern(line)
        if kind != order[len(part)]:
            part = []
        if kind == order[len(part)]:
            part.append(line.strip())
        if len(part) == len(order):
            found.append(BETWEEN.join(part))
            part = []
    return found if len(found) >= LEAST_READINGS else None


def _order(kinds: list[str]) -> list[str] | None:
    """The shortest order of different kinds that comes again and again."""
    for length in range(2, MOST_LINES + 1):
        pairs = list(zip(kinds, kinds[length:], strict=False))
        if len(pairs) < LEAST_READINGS * length or len(set(map(_words, kinds[:length]))) < length:
            continue
        if sum(a == b for a, b in pairs) >= REGULAR * len(pairs):
            return kinds[:length]
    return None


def _are_even(lines: list[str]) -> bool:
    """Whether nearly all lines have one number of cells, as rows of a table that take turns have."""
    some = list(enumerate(lines[len(lines) // 2 :][: dialect.HEAD]))
    _, delimiter = max((dialect.score(some, d)[0], d) for d in dialect.DELIMITERS)
    cells = Counter(len(dialect.split(line, delimiter)) for _, line in some)
    return cells.most_common(1)[0][1] >= REGULAR * len(some)


def _words(kind: str) -> str:
    """What is said in lines of a kind; numbers alone, in however many cells, are a table's rows."""
    return "".join(letter for letter in kind if letter.isalpha() or letter == "@")


def _first_of(lines: list[str], order: list[str], pattern: Callable[[str], str]) -> str:
    """The kind of the first line that is of the order."""
    return next((kind for line in lines if (kind := pattern(line)) in order), order[0])
