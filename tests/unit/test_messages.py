"""Messages: rendered in a language, kept as JSON, never lost."""

import ast
import pickle
import re
import string
import tomllib
from collections.abc import Iterator

import pytest

from station import errors
from station.messages import Message, languages, render, templates
from tests.source import PACKAGE, calls

ERRORS = {name for name, kind in vars(errors).items() if isinstance(kind, type) and issubclass(kind, Exception)}


def parameters(template: str) -> set[str]:
    return {name for _, name, _, _ in string.Formatter().parse(template) if name is not None}


def sent() -> Iterator[tuple[str, str, set[str]]]:
    """Where, id and parameter names of every message that the code makes with words of its own."""
    for path, call in calls():
        name = call.func.id if isinstance(call.func, ast.Name) else ""
        if (name not in ("Message", "report_text") and name not in ERRORS) or not call.args:
            continue
        first = call.args[0]
        if not isinstance(first, ast.Constant) or not isinstance(first.value, str) or " " in first.value:
            continue
        if any(k.arg is None for k in call.keywords):
            continue  # **parameters: checked where they are put together
        known = {str(k.arg) for k in call.keywords} - {"code", "below"}  # they are no parameters
        yield f"{path.relative_to(PACKAGE)}:{call.lineno}", first.value, known


@pytest.mark.parametrize("language", languages())
def test_every_language_says_every_message_with_the_same_parameters(language: str) -> None:
    english, other = templates("en"), templates(language)
    assert other.keys() == english.keys()
    assert {i: parameters(t) for i, t in other.items()} == {i: parameters(t) for i, t in english.items()}


def test_every_message_that_is_sent_stands_in_the_catalogue_with_its_parameters() -> None:
    english = templates("en")
    wrong = [
        f"{where}: {id_} wants {sorted(parameters(english[id_]))}, is given {sorted(given)}"
        if id_ in english
        else f"{where}: {id_} is in no catalogue"
        for where, id_, given in sent()
        if id_ not in english or parameters(english[id_]) - {"code"} != given
    ]
    assert wrong == []


def test_a_message_survives_json_and_pickling() -> None:
    message = Message("text", text=Message("text", text="inner"), names=("a", Message.text("b")))
    assert Message.of(message.document()) == message
    again = pickle.loads(pickle.dumps(errors.DeviceRefused("refused by the device", code=0x06010002)))
    assert (again.code, again.sentence) == (0x06010002, "refused by the device")
    assert pickle.loads(pickle.dumps(errors.RecipeError(message))).message == message


def test_a_message_of_a_later_version_still_says_its_parameters() -> None:
    assert render(Message("not-yet-known", axis="y", value=1.5)) == "not-yet-known axis=y value=1.5"


@pytest.mark.parametrize(("language", "name"), [("en", "gain y"), ("de", "Verstärkung y"), ("zh", "增益 y")])
def test_a_sentence_names_a_coefficient_in_its_own_language(language: str, name: str) -> None:
    beyond = Message("coefficient-beyond-limit", coefficient="gain y", deviation=-0.06, unit="", limit=0.05)
    assert render(beyond, language).startswith(f"{name} ")
    later = Message("coefficient-beyond-limit", coefficient="twist", deviation=-0.06, unit="", limit=0.05)
    assert render(later, language).startswith("twist ")


@pytest.mark.parametrize("language", languages())
def test_a_sentence_in_a_sentence_ends_once(language: str) -> None:
    value, key = Message("formula-value", value="nan"), Message("unknown-key-near", nearest="term")
    for reasons in ((value, key), (key, value)):
        rows = [Message("mistake-at-key", line=3, key="effects.0", reason=reason) for reason in reasons]
        text = render(Message("document-mistakes", file="model.yaml", mistakes=rows), language)
        assert not re.search(r"[.?。？][.。;；]", text.replace("?;", "").replace("？；", "")), text
        assert text[-1] in ".?。？"


def test_an_extra_is_installed_by_the_name_of_this_distribution() -> None:
    """`station` alone is somebody else's package: a remedy that named it would install that."""
    project = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = {f"{project['name']}[{extra}]" for extra in project["optional-dependencies"]}
    pages = [page.read_text(encoding="utf-8") for page in (PACKAGE.parent / "docs").rglob("*.md")]
    sentences = [sentence for language in languages() for sentence in templates(language).values()]
    named = re.findall(r"pip install [\"']?([\w-]+\[[^\]{]+\])", "\n".join(pages + sentences))
    assert named and set(named) <= extras
