"""Every text in every language: keys, verdict reasons, and the sentences that a run or the page can say."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import station
from station.messages import labels
from station.web.sentences import catalogue, translate

ROOT = Path(station.__file__).parent
OTHERS = sorted(set(labels.all_texts()) - {"en"})
#: Where every sentence is one that an operator may read: reasons, faults of unit, bus, fixture and log.
RUN_TIME = (
    *("domain/stop_check.py", "domain/quality.py", "domain/verification.py", "domain/judge.py", "domain/pipeline.py"),
    *("domain/stream.py", "domain/serial.py", "domain/golden.py", "domain/error_frames.py", "domain/sdo_codes.py"),
    *("domain/thermometer.py", "domain/writeback.py", "adapters/store/faults.py", "adapters/bus/_errors.py"),
    *("service/capture.py", "service/measure.py", "service/load.py", "service/identify.py", "service/recovery.py"),
    *("service/unit.py", "service/write_back.py", "service/bus_errors.py", "adapters/device/sdo_client.py"),
)
#: Where only what is raised is shown.
RAISED = ("adapters/bus/socketcan.py", "adapters/device/canopen_device.py", "adapters/positioner/*.py", "web/*.py")
#: Sentences for who writes code, recipes or device maps, or runs commands; no page shows them.
NOT_ON_A_PAGE = ("web/accounts.py",)
#: Names in the record, and what only a wrong program can say.
NO_SENTENCES = (
    *("compensated output", "raw output", "output switch", "configuration date", "configuration time"),
    *("read back after a reset", "the samples are of ", " units; give one at a time", "there is no NMT command "),
    "; the known ones are ",
)
_SHOWN = re.compile("(Fault|UsageError|LogError|Refused|Silent|Unit|Differs|Overdue|Already|Aborted|HTTPException)$")
_WORDS = re.compile(r"[a-z]{2,} [a-z]{2,}")


def pieces(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """The words of sentences between their values, and the line where they stand; no documentation, no commands."""
    silent = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr)}
    for part in ast.walk(tree):
        if isinstance(part, ast.JoinedStr):
            silent |= {id(inner) for inner in ast.walk(part)} - {id(part)}
    for part in ast.walk(tree):
        if id(part) in silent or not isinstance(part, ast.JoinedStr | ast.Constant):
            continue
        text = "".join(str(v.value) if isinstance(v, ast.Constant) else "\0" for v in getattr(part, "values", [part]))
        for words in re.sub("`[^`]*`", "\0", text).split("\0"):
            if _WORDS.search(words) and words not in NO_SENTENCES:
                yield part.lineno, words.strip(" ;:,.()")


def spoken() -> Iterator[str]:
    """`place: words` of everything that a page can show."""
    for patterns, only_raised in ((RUN_TIME, False), (RAISED, True)):
        for path in (path for pattern in patterns for path in sorted(ROOT.glob(pattern))):
            name = str(path.relative_to(ROOT))
            if name in NOT_ON_A_PAGE:
                continue
            tree = ast.parse(path.read_text(encoding="utf-8"))
            calls = [n for n in ast.walk(tree) if isinstance(n, ast.Call)]
            raised = [n for n in calls if _SHOWN.search(getattr(n.func, "id", ""))]
            for part in raised if only_raised else [tree]:
                yield from (f"{name}:{line}: {words}" for line, words in pieces(part))


def checks() -> set[str]:
    """Every code that a verdict's reason can bear."""
    found = {"offset", "gain", "cross-axis"}
    for path in [*(ROOT / "domain").rglob("*.py"), *(ROOT / "service").rglob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in ("Reason", "Reason.text", "_largest"):
                given = [k.value for k in node.keywords if k.arg == "check"] or node.args[:1]
                if isinstance(given[0], ast.Call):
                    given = given[0].args[:1]
                found |= {part.value for part in given if isinstance(part, ast.Constant)}
    from station import errors

    kinds = [v for v in vars(errors).values() if isinstance(v, type) and issubclass(v, errors.StationError)]
    run_time = [k for k in kinds if not issubclass(k, errors.InputError) and k is not errors.StationError]
    return found | {re.sub("(?<!^)([A-Z])", r"-\1", kind.__name__).lower() for kind in run_time}


def test_every_language_says_everything() -> None:
    texts = labels.all_texts()
    assert {"en", "de", "zh"} <= set(texts)
    for code, said in texts.items():
        assert set(said) == set(texts["en"]), code
        assert all(said.values()), code


def test_every_reason_has_a_name_in_every_language() -> None:
    wanted = checks()
    assert {"noise", "stuck", "verify", "device-silent", "offset", "residual", "aborted"} <= wanted
    for code, said in labels.all_texts().items():
        assert sorted(c for c in wanted if not said.get(f"check_{c}")) == [], code


@pytest.mark.parametrize("code", OTHERS)
def test_every_sentence_that_a_page_can_show_is_translated(code: str) -> None:
    known = "\n".join(re.sub(r"\{\d_?\}", "\0", english) for english in catalogue(code))
    missing = sorted({told for told in spoken() if told.split(": ", 1)[1] not in known})
    assert missing == [], f"add them to station/web/languages/sentences/{code}.json"


@pytest.mark.parametrize("code", OTHERS)
def test_a_translation_keeps_every_value(code: str) -> None:
    for english, said in catalogue(code).items():
        holes = [h.rstrip("_") for h in re.findall(r"\{(\d_?)\}", english)]
        assert sorted(holes) == sorted(re.findall(r"\{(\d)\}", said)), english
        values = {h: f"7{h}" for h in holes}
        filled = re.sub(r"\{(\d)_?\}", lambda hole, v=values: v[hole[1]], english)  # type: ignore[misc]
        told = translate(filled, code)
        assert told == said or filled != told, filled
        assert all(v in told for v in values.values()), f"{filled} → {told}"


def test_the_languages_know_the_same_sentences() -> None:
    first, *others = (set(catalogue(code)) for code in OTHERS)
    assert all(other == first for other in others)


def test_a_sentence_that_nobody_knows_stays_as_it_is() -> None:
    assert translate("nobody has ever said this", "de") == "nobody has ever said this"
    assert translate("axis z is clipped at 'x-up'", "en") == "axis z is clipped at 'x-up'"


NODE = "node 17 did not answer the request to read 0x2101:03 within 0.5 s; check power, wiring, bit rate and node id"
KNOTEN = (
    "Knoten 17 antwortete auf die Anfrage 0x2101:03 (lesen) nicht innerhalb von 0.5 s; Versorgung, Verdrahtung, "
    "Bitrate und Knotennummer prüfen"
)
NESTED = {
    "SN0002: axis z is clipped at 'x-up'; measuring it again": (
        "SN0002: Achse z ist bei 'x-up' am Anschlag; es wird noch einmal gemessen"
    ),
    "SN7: bad frames at 'z-up': 3 frames lost, at 2 places, 1 frames with a wrong CRC": (
        "SN7: fehlerhafte Telegramme bei 'z-up': 3 Telegramme verloren, an 2 Stellen, 1 Telegramme mit falscher CRC"
    ),
    "offset x is +0.0812 g, beyond 0.08 less the guard band 0.002": (
        "Offset x ist +0.0812 g, über der Grenze 0.08 abzüglich des Schutzbands 0.002"
    ),
    f"{NODE}; can0 is down: bring it up": f"{KNOTEN}; can0 ist ausgeschaltet: einschalten",
}


@pytest.mark.parametrize("english", NESTED)
def test_sentences_within_sentences(english: str) -> None:
    assert translate(english, "de") == NESTED[english]
    chinese = re.sub("'.*?'", "", translate(english, "zh")).replace("can0", "")
    assert not re.search("[a-z]{4,}", chinese), "nothing stayed English"


def test_a_long_list_of_reasons_is_translated_one_by_one() -> None:
    one = "axis x has 0.02 g of noise at 'x-{}', more than 0.01"
    told = translate("; ".join(one.format(i) for i in range(40)), "de")
    assert told.count("rauscht") == 40


def test_every_deed_in_the_journal_has_a_name() -> None:
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in (ROOT / "web").glob("*.py")]
    calls = [n for tree in trees for n in ast.walk(tree) if isinstance(n, ast.Call)]
    added = [n for n in calls if isinstance(n.func, ast.Attribute) and ast.unparse(n.func).endswith("journal.add")]
    deeds = {n.args[1].value for n in added if isinstance(n.args[1], ast.Constant)}
    assert {"log-in", "scan", "again", "confirm", "certificate"} <= deeds
    for code, said in labels.all_texts().items():
        assert sorted(d for d in deeds if f"deed_{d}" not in said) == [], code
