"""A formula for people: as plain text, and as MathML."""

from collections.abc import Mapping
from fractions import Fraction
from html import escape

from station.model.formula.expression import PI, Constant, Expression, Number, Sum, Variable
from station.model.formula.grammar import INPUTS, XYZ, FormulaColumn
from station.model.formula.term import Term, axis_places
from station.model.formula.writer import HALF, Writer, split_product, without_minus

_RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
#: Signs of variables and constants.
SIGNS = {
    "a": "a", "step": "Δa", "previous": "a_prev", "angle": "θ", "T": "T", "T_rate": "dT/dt", "t": "t",
    "t_power": "t_power", "t_clamp": "t_clamp", "t_arrival": "t_arrival", "motor": "motor",
    "about_degC": "T₀", "kink_degC": "T₁", "time_constant_s": "τ", "start_s": "t₀", "cycles_hz": "f", "bend_u": "b",
}  # fmt: skip
TURNED = {"device": "the device in its package", "nest": "the part in its nest", "station": "the rig on its base"}
#: Lines of a formula that are written out; one of more axes is written for any axis.
MOST_LINES = 3
ANY_AXIS = {"i": "i", "j": "j", "k": "k"}


def formula_text(term: Term) -> str:
    """Such as "reading_z += c · a_z² · (T − T₀)"."""
    if term.is_turn:
        return (
            f"{TURNED[INPUTS[term.input].frame]} is turned about {', '.join(term.axes)} by an angle of each {term.of}"
        )
    if is_generic(term):
        return f"reading_i += {_line(term, term.columns[0], 'c_i', ANY_AXIS)}"
    alone = len(term.axes) == 1
    return "; ".join(
        f"reading_{XYZ[c.i]} += {_line(term, c, 'c' if alone else f'c_{c.label}', named_places(c))}"
        for c in term.columns
    )


def is_generic(term: Term) -> bool:
    """Whether a formula is written for any axis."""
    return term.is_whole or len(term.axes) > MOST_LINES


def named_places(column: FormulaColumn) -> dict[str, str]:
    """The name of the axis at each place of a column."""
    return {place: XYZ[axis] for place, axis in axis_places(column.i, column.j).items()}


def _line(term: Term, column: FormulaColumn, coefficient: str, places: Mapping[str, str]) -> str:
    writer = TextWriter(places)
    parts = [writer.write(tree) for tree in term.tree(column) if tree != Number(Fraction(1))]
    return " · ".join([coefficient, *parts])


class TextWriter(Writer):
    """Plain text; places: the name of the axis at i, j and k."""

    def __init__(self, places: Mapping[str, str]) -> None:
        self._places = places

    def leaf(self, tree: Number | Variable | Constant) -> str:
        if isinstance(tree, Number):
            return "π" if tree.value == PI else str(tree.value).replace("-", "−")
        if isinstance(tree, Constant):
            return SIGNS[tree.field]
        return SIGNS[tree.name] + (f"_{self._places[tree.place]}" if tree.place else "")

    def sum(self, terms: tuple[Expression, ...]) -> str:
        return f"({self.bare_sum(terms)})"

    def bare_sum(self, terms: tuple[Expression, ...]) -> str:
        """A sum without brackets."""
        text = ""
        for n, term in enumerate(terms):
            minus, plain = without_minus(term)
            sign = (" − " if minus else " + ") if n else ("−" if minus else "")
            text += sign + self.write(plain)
        return text

    def product(self, factors: tuple[Expression, ...]) -> str:
        minus, above, below = split_product(factors)
        text = "·".join(self.write(f) for f in above) or "1"
        return ("−" if minus else "") + text + "".join(f"/{self.write(b)}" for b in below)

    def power(self, base: Expression, exponent: Fraction) -> str:
        return f"√{self.write(base)}" if exponent == HALF else f"{self.write(base)}{str(exponent).translate(_RAISED)}"

    def call(self, function: str, argument: Expression) -> str:
        inner = self.write(argument)
        if inner.startswith("(") and inner.endswith(")"):
            inner = inner[1:-1]
        return {"abs": f"|{inner}|", "positive": f"max(0, {inner})"}.get(function, f"{function}({inner})")


def formula_mathml(term: Term) -> str:
    """The same as presentation MathML; a turn, which is no product, as text."""
    if term.is_turn:
        return f"<mtext>{escape(formula_text(term))}</mtext>"
    generic = is_generic(term)
    rows = ""
    for column in term.columns[: 1 if generic else MOST_LINES]:
        places = ANY_AXIS if generic else named_places(column)
        writer = MathWriter(places)
        trees = [writer.write(t) for t in term.tree(column) if t != Number(Fraction(1))]
        right = "<mo>⋅</mo>".join([_sub("c", "i" if generic else column.label), *trees])
        rows += f"<mtr><mtd>{_sub('Δ reading', places['i'])}<mo>=</mo>{right}</mtd></mtr>"
    return f"<mtable>{rows}</mtable>"


def _sub(sign: str, below: str) -> str:
    return f"<msub><mi>{escape(sign)}</mi><mi>{escape(below)}</mi></msub>"


class MathWriter(Writer):
    """Presentation MathML."""

    def __init__(self, places: Mapping[str, str]) -> None:
        self._places = places

    def leaf(self, tree: Number | Variable | Constant) -> str:
        if isinstance(tree, Number):
            return f"<mn>{'π' if tree.value == PI else tree.value}</mn>"
        if isinstance(tree, Constant):
            return f"<mi>{escape(SIGNS[tree.field])}</mi>"
        return _sub(SIGNS[tree.name], self._places[tree.place]) if tree.place else f"<mi>{SIGNS[tree.name]}</mi>"

    def sum(self, terms: tuple[Expression, ...]) -> str:
        inner = ""
        for n, term in enumerate(terms):
            minus, plain = without_minus(term)
            inner += ("<mo>−</mo>" if minus else "<mo>+</mo>" if n else "") + self.write(plain)
        return f"<mrow><mo>(</mo>{inner}<mo>)</mo></mrow>"

    def product(self, factors: tuple[Expression, ...]) -> str:
        minus, above, below = split_product(factors)
        sign, dot = "<mo>−</mo>" if minus else "", "<mo>⋅</mo>"
        top = dot.join(self.write(f) for f in above) or "<mn>1</mn>"
        if not below:
            return f"<mrow>{sign}{top}</mrow>"
        under = dot.join(self.write(b) for b in below)
        return f"<mrow>{sign}<mfrac><mrow>{top}</mrow><mrow>{under}</mrow></mfrac></mrow>"

    def power(self, base: Expression, exponent: Fraction) -> str:
        inner = self.write(base)
        return f"<msqrt>{inner}</msqrt>" if exponent == HALF else f"<msup>{inner}<mn>{exponent}</mn></msup>"

    def call(self, function: str, argument: Expression) -> str:
        inner = self.write(argument)
        if function == "exp":
            return f"<msup><mi>e</mi>{inner}</msup>"
        if function == "abs":
            return f"<mrow><mo>|</mo>{inner}<mo>|</mo></mrow>"
        # A sum has brackets already, those of the function.
        inner = (
            inner.removeprefix("<mrow><mo>(</mo>").removesuffix("<mo>)</mo></mrow>")
            if isinstance(argument, Sum)
            else inner
        )
        name, before = {
            "positive": ("max", "<mn>0</mn><mo>,</mo>"),
            "log1p": ("ln", "<mn>1</mn><mo>+</mo>"),
            "sign": ("sgn", ""),
        }.get(function, (function, ""))
        return f"<mrow><mi>{name}</mi><mo>(</mo>{before}{inner}<mo>)</mo></mrow>"
