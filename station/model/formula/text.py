"""A formula for people: as plain text, and as MathML."""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from html import escape
from typing import assert_never

from station.model.formula.expression import Call, Constant, Expression, Number, Power, Product, Sum, Variable
from station.model.formula.grammar import INPUTS, XYZ, Column
from station.model.formula.term import Term, axis_places

_RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
#: Signs of variables and constants.
SIGNS = {
    "a": "a", "step": "Δa", "previous": "a_prev", "angle": "θ", "T": "T", "T_rate": "dT/dt", "t": "t",
    "t_power": "t_power", "t_clamp": "t_clamp", "t_arrival": "t_arrival", "motor": "motor",
    "about_degC": "T₀", "kink_degC": "T₁", "time_constant_s": "τ", "start_s": "t₀", "cycles_hz": "f", "bend_u": "b",
}  # fmt: skip
TURNED = {"device": "the device in its package", "nest": "the part in its nest", "station": "the rig on its base"}
_PI = Fraction(355, 113)


def formula_text(term: Term, coefficient: str = "c") -> str:
    """Such as "reading_z += c · a_z² · (T − T₀)"."""
    if term.is_turn:
        about = ", ".join(term.axes)
        return f"{TURNED[INPUTS[term.input].frame]} is turned about {about} by an angle of each {term.of}"
    if term.is_whole or len(term.axes) > 3:
        return f"reading_i += {_line(term, term.columns[0], f'{coefficient}_i', generic=True)}"
    return "; ".join(
        f"reading_{XYZ[c.i]} += {_line(term, c, coefficient if len(term.axes) == 1 else f'{coefficient}_{c.label}')}"
        for c in term.columns
    )


def _line(term: Term, column: Column, coefficient: str, *, generic: bool = False) -> str:
    places = dict(zip("ijk", "ijk", strict=True)) if generic else {
        p: XYZ[axis] for p, axis in axis_places(column.i, column.j).items()
    }  # fmt: skip
    parts = [tree_text(tree, places) for tree in term.tree(column) if tree != Number(Fraction(1))]
    return " · ".join([coefficient, *parts])


def tree_text(tree: Expression, places: Mapping[str, str]) -> str:
    """A tree in a line."""
    match tree:
        case Number(value):
            return "π" if value == _PI else str(value).replace("-", "−")
        case Variable(name, place):
            return SIGNS[name] + (f"_{places[place]}" if place else "")
        case Constant(field):
            return SIGNS[field]
        case Sum(terms):
            return f"({_joined([tree_text(t, places) for t in terms])})"
        case Product(factors):
            return _product(factors, places)
        case Power(base, exponent):
            inner = tree_text(base, places)
            if exponent == Fraction(1, 2):
                return f"√{inner}"
            return f"{inner}{str(exponent).translate(_RAISED)}"
        case Call("abs", argument):
            return f"|{tree_text(argument, places)}|"
        case Call("positive", argument):
            return f"max(0, {tree_text(argument, places).removeprefix('(').removesuffix(')')})"
        case Call(function, argument):
            inner = tree_text(argument, places)
            return f"{function}({inner.removeprefix('(').removesuffix(')') if inner.startswith('(') else inner})"
    assert_never(tree)


def _joined(parts: Sequence[str]) -> str:
    text = parts[0]
    for part in parts[1:]:
        text += f" − {part[1:]}" if part.startswith("−") else f" + {part}"
    return text


def _product(factors: Sequence[Expression], places: Mapping[str, str]) -> str:
    sign, above, below = "", [], []
    for f in factors:
        if f == Number(Fraction(-1)):
            sign = "−"
        elif isinstance(f, Power) and f.exponent == -1:
            below.append(tree_text(f.base, places))
        else:
            above.append(tree_text(f, places))
    text = "·".join(above) or "1"
    return sign + text + "".join(f"/{b}" for b in below)


def formula_mathml(term: Term) -> str:
    """The same as presentation MathML; text of a turn, which is no product."""
    if term.is_turn:
        return f"<mtext>{escape(formula_text(term))}</mtext>"
    generic = term.is_whole or len(term.axes) > 3
    rows = []
    for column in term.columns[: 1 if generic else None]:
        places = dict(zip("ijk", "ijk", strict=True)) if generic else {
            p: XYZ[axis] for p, axis in axis_places(column.i, column.j).items()
        }  # fmt: skip
        trees = [t for t in term.tree(column) if t != Number(Fraction(1))]
        i = places["i"]
        right = "<mo>⋅</mo>".join([_sub("c", i if generic else column.label), *(tree_mathml(t, places) for t in trees)])
        rows.append(f"<mrow>{_sub('Δ reading', i)}<mo>=</mo>{right}</mrow>")
    return "<mtable>" + "".join(f"<mtr><mtd>{row}</mtd></mtr>" for row in rows) + "</mtable>"


def _sub(sign: str, below: str) -> str:
    return f"<msub><mi>{escape(sign)}</mi><mi>{escape(below)}</mi></msub>"


def tree_mathml(tree: Expression, places: Mapping[str, str]) -> str:
    """A tree as presentation MathML."""
    match tree:
        case Number(value):
            return f"<mn>{'π' if value == _PI else value}</mn>"
        case Variable(name, place):
            sign = SIGNS[name]
            return _sub(sign, places[place]) if place else f"<mi>{escape(sign)}</mi>"
        case Constant(field):
            return f"<mi>{escape(SIGNS[field])}</mi>"
        case Sum(terms):
            return f"<mrow><mo>(</mo>{_sum_mathml(terms, places)}<mo>)</mo></mrow>"
        case Product(factors):
            return _product_mathml(factors, places)
        case Power(base, exponent):
            inner = tree_mathml(base, places)
            if exponent == Fraction(1, 2):
                return f"<msqrt>{inner}</msqrt>"
            return f"<msup>{inner}<mn>{exponent}</mn></msup>"
        case Call("abs", argument):
            return f"<mrow><mo>|</mo>{tree_mathml(argument, places)}<mo>|</mo></mrow>"
        case Call("exp", argument):
            return f"<msup><mi>e</mi>{tree_mathml(argument, places)}</msup>"
        case Call(function, argument):
            name = {"positive": "max(0, ·)"}.get(function, function)
            return f"<mrow><mi>{name}</mi><mo>(</mo>{tree_mathml(argument, places)}<mo>)</mo></mrow>"
    assert_never(tree)


def _sum_mathml(terms: Sequence[Expression], places: Mapping[str, str]) -> str:
    out = ""
    for n, t in enumerate(terms):
        minus = isinstance(t, Product) and t.factors[0] == Number(Fraction(-1))
        inner = Product(t.factors[1:]) if minus and isinstance(t, Product) else t
        out += ("<mo>−</mo>" if minus else "<mo>+</mo>" if n else "") + tree_mathml(inner, places)
    return out


def _product_mathml(factors: Sequence[Expression], places: Mapping[str, str]) -> str:
    sign = "<mo>−</mo>" if Number(Fraction(-1)) in factors else ""
    below = [f.base for f in factors if isinstance(f, Power) and f.exponent == -1]
    above = [
        f for f in factors if f != Number(Fraction(-1)) and not (isinstance(f, Power) and f.exponent == -1)
    ]
    top = "<mo>⋅</mo>".join(tree_mathml(f, places) for f in above) or "<mn>1</mn>"
    if below:
        under = "<mo>⋅</mo>".join(tree_mathml(f, places) for f in below)
        return f"<mrow>{sign}<mfrac><mrow>{top}</mrow><mrow>{under}</mrow></mfrac></mrow>"
    return f"<mrow>{sign}{top}</mrow>"
