"""Messages as `rostopic echo` prints them, one YAML document each: lines of a table."""

import re

from station.adapters.recordings import dialect

_END = "---"
_ENTRY = re.compile(r"^(?P<indent>\s*)(?P<key>[A-Za-z_]\w*):\s*(?P<value>.*?)\s*$")
_FEWEST = 8
_SECONDS, _NANOSECONDS = ("secs", "sec"), ("nsecs", "nanosec")


def table_lines(lines: list[str]) -> list[str] | None:
    """A header of the paths of all numbers, and a row a message; None where the lines are no such messages."""
    ends = [i for i, line in enumerate(lines) if line.strip() == _END]
    if len(ends) < _FEWEST or _ENTRY.match(next((x for x in lines if x.strip()), "")) is None:
        return None
    starts = [0, *(i + 1 for i in ends)]
    found = [_numbers(lines[a:b]) for a, b in zip(starts, [*ends, len(lines)], strict=True)]
    whole = [numbers for numbers in found if numbers]
    names = list(whole[len(whole) // 2]) if whole else []
    if not names:
        return None
    return [";".join(names), *(";".join(numbers.get(name, "") for name in names) for numbers in whole)]


def _numbers(lines: list[str]) -> dict[str, str]:
    """The numbers of one message by their path; seconds and nanoseconds of a stamp as one number."""
    path: list[tuple[int, str]] = []
    found: dict[str, str] = {}
    for line in lines:
        if (entry := _ENTRY.match(line)) is None:
            continue
        indent = len(entry["indent"])
        while path and path[-1][0] >= indent:
            path.pop()
        parents = [key for _, key in path]
        if dialect.is_number(entry["value"]):
            found[".".join([*parents, entry["key"]])] = entry["value"]
        path.append((indent, entry["key"]))
    return _with_stamp(found)


def _with_stamp(found: dict[str, str]) -> dict[str, str]:
    for name, seconds in found.items():
        head, _, key = name.rpartition(".")
        parts = [found.get(f"{head}.{nano}") for nano in _NANOSECONDS]
        nanoseconds = next((p for p in parts if p is not None and p.isdigit()), None)
        if key in _SECONDS and seconds.isdigit() and nanoseconds is not None:
            rest = {n: v for n, v in found.items() if not n.startswith(f"{head}.")}
            return {"time_ns": str(int(seconds) * 10**9 + int(nanoseconds)), **rest}
    return found
