"""A term written as an effect file in the form of the others, from its tree: no text of anybody is ever run."""

import builtins
import keyword
import re
from collections.abc import Iterator, Mapping
from fractions import Fraction
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from station.model.formula.expression import PI, Constant, Expression, Multiplication, Number, Sum, Variable, variables
from station.model.formula.grammar import CONSTANTS, INPUTS, ConstantKind, FormulaColumn
from station.model.formula.term import COVARIATE_OF, Term, axis_places
from station.model.formula.term_effect import RIG_LEVELS, drawn_over, effect_of, parameter_of, shown_by
from station.model.formula.text import formula_text
from station.model.formula.writer import HALF, Writer, split_product, without_minus
from station.model.scene import Scene, Signal

#: A name of an effect: words of small letters and digits, joined by hyphens.
NAME = re.compile(r"[a-z][a-z0-9]{0,30}(-[a-z0-9]{1,30}){0,5}")
#: Classes that the files import, and names that the station gives to formulas.
IMPORTED = ("Floats", "Parameter", "PoseEffect", "Scene", "SensorEffect", "Signal", "SimpleNamespace")
NUMBERED = re.compile(r"formula-[0-9]+")
#: Longest line of a file, and longest physics sentence.
MOST_COLUMNS, MOST_PHYSICS = 120, 120
#: The range about a size that one campaign found.
RANGE = 10.0
#: The example of a file: times, what is felt at two visits, and covariates.
EXAMPLE_TIMES, EXAMPLE_FELT = [1.0, 30.0], [[0.6, 0.0, 0.8], [0.0, -0.6, 0.8]]
EXAMPLE = {
    "temperature_degC": [20.0, 35.0],
    "temperature_rate": [0.01, 0.02],
    "since_power_s": [10.0, 40.0],
    "since_clamp_s": [10.0, 40.0],
    "since_arrival_s": [0.0, 0.1],
    "motor": [0.0, 0.5],
}
#: Words that stand for a covariate in the code.
WORDS = {
    "T": "temperature", "T_rate": "rate", "t": "t", "t_power": "since_power", "t_clamp": "since_clamp",
    "t_arrival": "since_arrival", "motor": "motor",
}  # fmt: skip


class SizeMet(NamedTuple):
    """Rms of the coefficients found, for a stimulus of 1, and the smallest and largest met."""

    typical: float
    low: float
    high: float

    @classmethod
    def once(cls, size: float) -> "SizeMet":
        """Of one campaign, which says nothing of the range."""
        return cls(size, size / RANGE, size * RANGE)


def effect_source(term: Term, name: str, size: SizeMet, source: str) -> str:
    """The text of an effect file. source: where the size comes from."""
    term = term.with_constants(**{field: float(f"{value:.6g}") for field, value in term.constants})
    blocks = [_head(term, name, source), *_imports(term), "", "", *_class(term, name, size, source)]
    return "\n".join(blocks) + "\n"


def class_name(name: str) -> str:
    """Such as ThermalSquare."""
    return "".join(word.capitalize() for word in name.split("-"))


def is_reserved(name: str) -> bool:
    """Whether a name stands for something else: a word of Python, a class of the files, a formula without a name."""
    kind = class_name(name)
    words = keyword.iskeyword(name) or keyword.iskeyword(kind) or hasattr(builtins, kind)
    return words or kind in IMPORTED or NUMBERED.fullmatch(name) is not None


def _head(term: Term, name: str, source: str) -> str:
    lines = ['"""' + _physics(term), "", *_wrapped(f"{formula_text(term)}; {source}."), ""]
    return "\n".join([*lines, *_example(term, name), '"""', ""])


def _physics(term: Term) -> str:
    """One sentence, to be replaced by whoever knows the reason."""
    text = f"A law found in data, not yet explained: {formula_text(term)}."
    return (
        text
        if len(text) <= MOST_PHYSICS
        else f"A law found in data, not yet explained: {term.input}, {term.modulator}."
    )


def _wrapped(text: str) -> Iterator[str]:
    line = ""
    for word in text.split(" "):
        if len(line) + len(word) + 1 > MOST_COLUMNS:
            yield line
            line = word
        else:
            line = f"{line} {word}".strip()
    yield line


def _example(term: Term, name: str) -> Iterator[str]:
    """A doctest whose answer is the tree's own."""
    yield ">>> import numpy as np"
    axes = len(term.axes)
    if term.is_turn:
        small = np.zeros((1, axes))
        small[0, -1] = 0.001
        turned: Any = effect_of(term, name, 1e-3)
        yield f">>> {class_name(name)}.example().apply(np.array({small.tolist()})).tolist()"
        yield str(turned.apply(small).tolist())
        return
    yield ">>> from types import SimpleNamespace"
    yield ">>> from station.model.scene import Scene, Signal"
    needed = {COVARIATE_OF.get(v) for c in term.columns for tree in term.tree(c) for v in variables(tree)}
    given = {name: values for name, values in EXAMPLE.items() if name in needed}
    known = ", ".join(f"{name}=np.array({values})" for name, values in given.items())
    yield ">>> visits = SimpleNamespace(previous=np.array([-1, 0]))"
    yield f">>> scene = Scene(None, visits, np.arange(2), np.array({EXAMPLE_TIMES})" + ("," if known else ")")
    if known:
        yield f"...     {known})"
    yield f">>> true = np.array({EXAMPLE_FELT})"
    yield f">>> c = np.outer([1.0, 2.0], np.ones({axes}))"
    yield f">>> {class_name(name)}.example().apply(Signal(scene, true, true), c).round(4).tolist()"
    effect: Any = effect_of(term, name, 1.0)
    answer = effect.apply(_example_signal(given), np.outer([1.0, 2.0], np.ones(axes)))
    yield str((np.round(answer, 4) + 0.0).tolist())


def _example_signal(given: Mapping[str, list[float]]) -> Signal:
    known: dict[str, Any] = {name: np.array(values) for name, values in given.items()}
    visits: Any = SimpleNamespace(previous=np.array([-1, 0]))
    nothing: Any = None
    scene = Scene(nothing, visits, np.arange(2), np.array(EXAMPLE_TIMES), **known)
    return Signal(scene, np.array(EXAMPLE_FELT), np.array(EXAMPLE_FELT))


def _imports(term: Term) -> Iterator[str]:
    yield "from dataclasses import dataclass"
    yield ""
    if term.is_turn:
        yield "from station.model.effect import Parameter, PoseEffect"
        return
    yield "import numpy as np"
    yield ""
    yield "from station.domain.core.types import Floats"
    yield "from station.model.effect import Parameter, SensorEffect"
    yield "from station.model.scene import Signal"


def _class(term: Term, name: str, met: SizeMet, source: str) -> Iterator[str]:
    base = "PoseEffect" if term.is_turn else "SensorEffect"
    of = (term.of, *(x for x in ("unit", "common") if x != term.of)) if term.of in ("unit", "common") else (term.of,)
    yield "@dataclass(frozen=True)"
    yield f"class {class_name(name)}({base}):"
    whose = "common, per" if term.of == "common" else f"per {term.of} and"
    yield f'    """{parameter_of(term, 1.0, "").name.capitalize()}, {whose} axis."""'
    yield ""
    yield f'    physics = "{_physics(term)}"'
    yield '    remedy = "find what makes it, with the covariates of the formula as a guide"'
    yield f'    shown_by = "{shown_by(term)}"'
    yield f'    drawn_over = "{drawn_over(term)}"'
    yield f'    level = "{"rig" if term.of in RIG_LEVELS else "device"}"'
    yield f"    of = {_strings(of)}"
    yield from _wide("axes", "(", [f'"{axis}"' for axis in term.axes], ")", tail=len(term.axes) == 1)
    if term.is_turn:
        yield f'    frame = "{INPUTS[term.input].frame}"'
    unit = parameter_of(term, met.typical, source)
    numbers = _numbers(unit.name, unit.unit, met.typical, (met.low, met.high), source)
    yield from _wide("parameter", "Parameter(", numbers, ")")
    forms = [(CONSTANTS[f], value) for f, value in term.constants]
    if forms:
        yield "    forms = ("
        yield from (line for kind, value in forms for line in _form(kind, value, source))
        yield "    )"
    if term.needs:
        yield f"    needs = {_strings(term.needs)}"
    yield "    size: float = parameter.typical"
    for i, (field, _) in enumerate(term.constants):
        yield f"    {field}: float = forms[{i}].typical"
    if not term.is_turn:
        yield ""
        yield from _apply(term)


def _strings(words: tuple[str, ...]) -> str:
    return "(" + ", ".join(f'"{w}"' for w in words) + ("," if len(words) == 1 else "") + ")"


def _wide(name: str, opened: str, parts: list[str], closed: str, *, tail: bool = False) -> Iterator[str]:
    """NAME = OPENED parts CLOSED, on as many lines as it takes."""
    whole = f"    {name} = {opened}{', '.join(parts)}{',' if tail else ''}{closed}"
    if len(whole) <= MOST_COLUMNS:
        yield whole
        return
    yield f"    {name} = {opened}"
    yield from (f"        {part}," for part in parts)
    yield f"    {closed}"


def _numbers(name: str, unit: str, typical: float, ends: tuple[float, float], source: str) -> list[str]:
    numbers = [f"{x:.6g}" for x in (typical, *ends)]
    return [f'"{name}"', f'"{unit}"', *numbers, f'"{source}"']


def _form(kind: ConstantKind, value: float, source: str) -> Iterator[str]:
    """A parameter of the form; a time constant is looked for on a grid."""
    scanned = kind.name == "time_constant"
    parts = _numbers(
        kind.name, kind.unit, value, (value / RANGE, value * RANGE) if scanned else (kind.low, kind.high), source
    )
    if scanned:
        parts.append(f"grid=({value / 2:.6g}, {value:.6g}, {2 * value:.6g})")
    yield "        Parameter("
    yield from (f"            {part}," for part in parts)
    yield "        ),"


def _apply(term: Term) -> Iterator[str]:
    needed = {v for c in term.columns for tree in term.tree(c) for v in variables(tree)}
    yield "    def apply(self, signal: Signal, c: Floats) -> Floats:"
    yield '        """The formula above, each coefficient on its axis."""'
    yield "        true = signal.true"
    if "step" in needed:
        yield "        step = signal.step"
    if "previous" in needed:
        yield "        previous = signal.step + signal.at_visit[signal.scene.visit]"
    for variable, covariate in COVARIATE_OF.items():
        if variable in needed:
            made = "signal.scene.time_s" if covariate == "time_s" else f'signal.scene.require("{covariate}")'
            yield f"        {WORDS[variable]} = {made}"
    yield "        added = np.zeros_like(true)"
    for at, column in enumerate(term.columns):
        yield f"        added[:, {column.i}] += {_column(term, column, at)}"
    yield "        return added"


def _column(term: Term, column: FormulaColumn, at: int) -> str:
    writer = PythonWriter(axis_places(column.i, column.j))
    parts = [writer.factor(tree) for tree in term.tree(column) if tree != Number(Fraction(1))]
    return " * ".join([f"c[:, {at}]", *parts])


class PythonWriter(Writer):
    """Python over arrays; places: the axis at i, j and k."""

    def __init__(self, places: dict[str, int]) -> None:
        self._places = places

    def factor(self, tree: Expression) -> str:
        """A tree as a factor of a product."""
        text = self.write(tree)
        return f"({text})" if isinstance(tree, Multiplication) and " " in text else text

    def leaf(self, tree: Number | Variable | Constant) -> str:
        if isinstance(tree, Number):
            return "np.pi" if tree.value == PI else str(tree.value)
        if isinstance(tree, Constant):
            return f"self.{tree.field}"
        if not tree.place:
            return WORDS[tree.name]
        axis = self._places[tree.place]
        if tree.name == "angle":
            return f"np.arctan2(true[:, {(axis + 1) % 3}], true[:, {(axis + 2) % 3}])"
        return f"{'true' if tree.name == 'a' else tree.name}[:, {axis}]"

    def sum(self, terms: tuple[Expression, ...]) -> str:
        text = ""
        for n, term in enumerate(terms):
            minus, plain = without_minus(term)
            text += ((" - " if minus else " + ") if n else ("-" if minus else "")) + self.write(plain)
        return f"({text})"

    def product(self, factors: tuple[Expression, ...]) -> str:
        minus, above, below = split_product(factors)
        text = " * ".join(self.factor(f) for f in above) or "1.0"
        return ("-" if minus else "") + text + "".join(f" / {self.factor(b)}" for b in below)

    def power(self, base: Expression, exponent: Fraction) -> str:
        inner = self.factor(base)
        return f"np.sqrt(np.maximum({inner}, 0.0))" if exponent == HALF else f"{inner} ** {exponent}"

    def call(self, function: str, argument: Expression) -> str:
        inner = self.write(argument)
        if isinstance(argument, Sum):
            inner = inner[1:-1]
        return f"np.maximum({inner}, 0.0)" if function == "positive" else f"np.{function}({inner})"
