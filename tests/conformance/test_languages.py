"""Every text in every language: keys, verdict reasons, terms; and no sentence that is written in the code itself."""

import ast
import re
from collections.abc import Iterator

import pytest

from station import errors
from station.domain.methods import coefficients
from station.messages import Message, labels, languages, templates
from station.reporting.line.statistics import CYCLE_PARTS, VALUE_NAMES
from station.reporting.words import words_of
from station.web import language
from tests.source import PACKAGE, calls

ERRORS = {n for n, kind in vars(errors).items() if isinstance(kind, type) and issubclass(kind, errors.StationError)}


def checks() -> set[str]:
    """Every code that a verdict's reason can bear."""
    found = {"offset", "gain", "cross-axis", "residual", "tilt", "consistency"}
    for path, node in calls():
        room = path.relative_to(PACKAGE).parts[0]
        if room in ("domain", "service") and ast.unparse(node.func) in ("Reason", "Reason.text", "_largest"):
            given = [k.value for k in node.keywords if k.arg == "check"] or node.args[4:5] or node.args[:1]
            if isinstance(given[0], ast.Call):
                given = given[0].args[:1]
            constants = [part.value for part in given if isinstance(part, ast.Constant)]
            found |= {value for value in constants if isinstance(value, str)}
    kinds = [v for v in vars(errors).values() if isinstance(v, type) and issubclass(v, errors.StationError)]
    run_time = [k for k in kinds if not issubclass(k, errors.InputError) and k is not errors.StationError]
    return found | {re.sub("(?<!^)([A-Z])", r"-\1", kind.__name__).lower() for kind in run_time}


def test_every_language_says_everything() -> None:
    texts = labels.all_texts()
    assert {"en", "de", "zh"} <= set(texts)
    for code, printed in texts.items():
        assert set(printed) == set(texts["en"]), code
        assert all(printed.values()), code


def test_every_reason_has_a_name_in_every_language() -> None:
    wanted = checks()
    assert {"noise", "stuck", "verify", "device-silent", "offset", "residual", "aborted"} <= wanted
    for code, printed in labels.all_texts().items():
        assert sorted(c for c in wanted if not printed.get(f"check_{c}")) == [], code


def literal_sentences() -> Iterator[str]:
    """Place of every error, reason or notice with words of its own instead of an id."""
    for path, node in calls():
        if path.is_relative_to(PACKAGE / "messages") or not node.args:
            continue
        name, first = ast.unparse(node.func), node.args[0]
        text = name in ("Reason.text", "Message.text") and isinstance(first, ast.Constant | ast.JoinedStr)
        words = isinstance(first, ast.Constant) and isinstance(first.value, str) and " " in first.value
        sentence = isinstance(first, ast.JoinedStr) and any(
            isinstance(part, ast.Constant) and " " in str(part.value) for part in first.values
        )
        if text or (name in ERRORS and (words or sentence)):
            yield f"{path.relative_to(PACKAGE)}:{node.lineno}"


def test_no_sentence_stands_in_the_code() -> None:
    assert list(literal_sentences()) == []


@pytest.mark.parametrize("code", languages())
def test_every_quantity_of_the_charts_has_a_name(code: str) -> None:
    words = words_of(code)
    names = {*coefficients.NAMES, *VALUE_NAMES, *CYCLE_PARTS, "moving range", "beyond 3σ", "second half − first"}
    assert sorted(n for n in names if f"term-{_slug(n)}" not in templates(code)) == []
    if code != "en":
        assert words.term("gain x") != "gain x"
    assert words.term("a name of nobody") == "a name of nobody"


def _slug(name: str) -> str:
    plain = name.lower().replace("σ", "sigma").replace("−", "minus")
    return "-".join(re.findall("[a-z0-9]+", plain))


@pytest.mark.parametrize("code", languages())
def test_a_recorded_message_is_rendered_and_an_older_sentence_stands_as_it_was(code: str) -> None:
    clipped = Message("axis-clipped", axis="z", limit=2.0, unit="g", position="x-up")
    rendered = language.sentence(clipped.document(), code)
    assert all(part in rendered for part in ("z", "2", "'x-up'"))
    assert (rendered == language.sentence(clipped, "en")) is (code == "en")
    assert language.sentence("axis z is clipped at 'x-up'", code) == "axis z is clipped at 'x-up'"
    assert Message.recorded({"sentence": "axis z is clipped"}) == Message.text("axis z is clipped")


def test_every_deed_in_the_journal_has_a_name() -> None:
    web = PACKAGE / "web"
    # A call, or one that is handed to a thread with its arguments behind it.
    words = [[n.func, *n.args] for path, n in calls() if path.parent == web]
    places = [(row, i) for row in words for i, word in enumerate(row) if ast.unparse(word).endswith("journal.add")]
    constants = [d.value for d in (row[i + 2] for row, i in places) if isinstance(d, ast.Constant)]
    actions = {value for value in constants if isinstance(value, str)}
    assert {"log-in", "scan", "again", "confirm", "certificate"} <= actions
    for code, printed in labels.all_texts().items():
        assert sorted(d for d in actions if f"deed_{d}" not in printed) == [], code
