"""What a term of a formula depends on, in the words of `unknown.depends_on`."""

from station.model.formula.term import Term

#: Words for what is recorded beside the readings; a clock's is "time".
WORD_OF = {
    "temperature_degC": "temperature", "temperature_rate": "temperature", "since_arrival_s": "dwell-phase",
    "motor": "motor",
}  # fmt: skip
#: Words for the levels at which a coefficient is shared that say something of their own.
LEVEL_WORDS = {"position": "position", "nest": "group", "station": "group", "lot": "group", "operator": "group"}


def term_covariates(term: Term) -> tuple[str, ...]:
    """Words of `unknown.depends_on` for a term: how it is modulated, what it feels, who shares it."""
    words = [WORD_OF.get(need, "time") for need in term.needs]
    if term.modulator != "constant" and not words:
        words.append("time")
    if term.input.startswith(("step", "previous")):
        words.append("order")
    elif term.input != "one" and not term.is_turn:
        words.append("input")
    if term.of in LEVEL_WORDS:
        words.append(LEVEL_WORDS[term.of])
    return tuple(dict.fromkeys(words)) or ("unit",)
