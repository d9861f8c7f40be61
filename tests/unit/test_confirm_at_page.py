"""A question at the page ends with its answer, or with the page: a dead one can neither answer nor stop."""

import json
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from station.cli._confirm import PageConfirmation
from station.cli._pacing import RealTimePacer
from station.errors import Aborted
from station.messages import Message
from station.panel_protocol.live_state import LiveStateWriter
from station.panel_protocol.presence import is_served, serving
from station.service.stop_request import StopRequest
from station.wiring.jobs import load_job

PAGE = """
import pathlib, sys
from station.panel_protocol.presence import serving
with serving(pathlib.Path(sys.argv[1])):
    print(flush=True)
    input()
"""


TURN = Message.text("turn SN1 in its nest")


def requested(database: Path, patience_s: float) -> PageConfirmation:
    job, _ = load_job("six-point")
    stop = StopRequest()
    return PageConfirmation(
        database,
        LiveStateWriter(database, job.recipe, {}, print),
        RealTimePacer(None, lambda: 0.0, stop),
        stop,
        patience_s,
    )


def test_a_page_that_is_killed_is_gone_at_once_and_a_second_one_counts(tmp_path: Path) -> None:
    database = tmp_path / "s.db"
    assert not is_served(database)
    pages = [
        subprocess.Popen([sys.executable, "-c", PAGE, database], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        for _ in range(2)
    ]
    for page in pages:
        assert page.stdout is not None
        page.stdout.readline()
    for page in pages:
        assert is_served(database)
        page.kill()
        page.communicate()
    assert not is_served(database)


def test_without_a_page_a_question_becomes_a_stop(tmp_path: Path) -> None:
    with pytest.raises(Aborted, match="The operator's page is no longer served: start `station panel`"):
        requested(tmp_path / "s.db", patience_s=0.1)(TURN)
    shown = json.loads((tmp_path / "s.db.live.json").read_text())
    assert shown["state"]["question"] == "", "what nobody can answer is not shown any longer"


def test_with_a_page_it_waits_for_the_answer(tmp_path: Path) -> None:
    database = tmp_path / "s.db"
    ended = threading.Event()

    def question() -> None:
        requested(database, patience_s=0.0)(TURN)
        ended.set()

    with serving(database):
        waiting = threading.Thread(target=question)
        waiting.start()
        live = tmp_path / "s.db.live.json"
        while not live.exists():
            assert waiting.is_alive()
        assert not ended.wait(0.3), "longer than its patience, but the page is there"
        mark = json.loads(live.read_text())["state"]["question"]
        (tmp_path / "s.db.answer.json").write_text(json.dumps({"question": mark}))
        assert ended.wait(30)
        waiting.join()
