"""An operator at the page, with real runs on the virtual bus: confirms a seating, scans the next load, scans again."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from station.adapters.store.reader import SqliteLogReader
from station.config.settings import load_settings
from station.panel_protocol import accounts
from station.panel_protocol.accounts import Account, Role
from station.panel_protocol.presence import serving
from station.panel_protocol.queue import WaitingUnit
from station.ports.log_reader import Query
from station.web.app import create_app
from station.web.panel import Panel
from station.web.run_launcher import LaunchOptions
from station.wiring.jobs import load_job
from tests.fakes import fixture_run
from tests.fakes.passwords import quick_hash
from tests.fakes.waiting import until

PASSWORD = "correct horse"
TURNED = {"axis": [0, 0, 1], "angle_deg": 180}
TWO_RUNS = [{"seating": "home", "order": "listed"}, {"seating": "turned", "order": "reversed"}]


class Page:
    """One person's page on a panel."""

    def __init__(self, panel: Panel, name: str) -> None:
        self.panel, self.client = panel, TestClient(create_app(panel), follow_redirects=False)
        self.client.post("/login", data={"name": name, "password": PASSWORD})
        session = panel.sessions.find(self.client.cookies["station_session"])
        assert session is not None
        self._csrf = session.csrf

    def do(self, action: str, **printed: str) -> dict[str, Any]:
        """The answer to a deed."""
        answer = self.client.post("/command", data={"action": action, "csrf": self._csrf, **printed})
        assert (answer.status_code == 409) == ("error" in answer.json())
        return dict(answer.json())

    def shown(self, key: str) -> Any:
        """What the screens show now."""
        self.panel.screen._looked_s = 0.0
        return self.panel.screen.shown()[key]

    def nest(self, name: str) -> dict[str, Any]:
        """One nest as the screens show it."""
        return dict(self.shown(f"nest {name}"))

    def wait_for_question(self) -> str:
        """The mark of the question that the run asks."""
        until(lambda: bool(self.shown("confirm").get("question")) or not self.shown("running"), "a question")
        assert self.shown("running"), self.shown("fault")
        return str(self.shown("confirm")["question"])

    def wait_for_end(self) -> None:
        """Until no run is under way."""
        until(lambda: not self.shown("running"), "the end of the run")


@pytest.fixture(scope="module")
def people() -> dict[str, Account]:
    hashed = quick_hash(PASSWORD)
    return {role.value: Account(role.value, role, hashed) for role in Role}


@pytest.fixture
def make(tmp_path: Path, people: dict[str, Account]) -> Iterator[Callable[..., Panel]]:
    """Panels on the log of this test."""
    accounts.save(tmp_path / "accounts.json", people)
    made: list[Panel] = []

    def panel(recipe: str = "six-point", config: Path | None = None, **more: Any) -> Panel:
        job, _ = load_job(recipe)
        order = LaunchOptions(tmp_path / "station.db", recipe, config, simulate=True, **more)
        made.append(Panel(load_settings(config), job.recipe, order, tmp_path / "accounts.json"))
        return made[-1]

    with serving(tmp_path / "station.db"):
        yield panel
    for each in made:
        if each.runs._child is not None and each.runs._child.poll() is None:
            each.runs.stop()
            each.runs._child.wait(30)


@pytest.fixture
def reseated(tmp_path: Path) -> str:
    """Six faces at home, then six with every unit turned in its nest."""
    return fixture_run.recipe(tmp_path, seatings={"turned": TURNED}, runs=TWO_RUNS)


def test_a_reseating_waits_for_the_page_and_goes_on_when_it_is_confirmed(
    make: Callable[..., Panel], reseated: str, tmp_path: Path
) -> None:
    page = Page(make(reseated), "operator")
    page.do("scan", serial="SN0001")
    page.do("start")
    mark = page.wait_for_question()
    assert "turned" in page.shown("confirm")["confirm"]["seating"]
    plan, line = page.panel.screen.plan(page.shown("plan")), page.shown("line")
    cell = plan["cells"][line["cell"]]
    assert (cell["kind"], page.shown("view")["why"]) == ("turn", "question")
    assert plan["pictures"][cell["picture"]] != plan["pictures"][cell["before"]]
    assert "no longer open" in page.do("confirm", question="0" * 16)["error"]
    assert page.shown("confirm")["question"] == mark, "a wrong mark confirms nothing"
    with SqliteLogReader(tmp_path / "station.db") as log:
        assert len(log.life(Query(serial="SN0001"))[0]["visits"]) == 6, "nothing is measured while a person turns it"
    page.do("confirm", question=mark)
    page.wait_for_end()
    assert page.nest("A")["outcome"] == "PASS"
    with SqliteLogReader(tmp_path / "station.db") as log:
        (life,) = log.life(Query(serial="SN0001"))
    assert [v["seating"] for v in life["visits"] if v["kind"] == "tumble"] == ["home"] * 6 + ["turned"] * 6
    actions = [(line["person"], line["deed"]) for line in page.panel.journal.lines()]
    assert actions == [("operator", d) for d in ("log-in", "scan", "start", "confirm")]
    assert "turned" in list(page.panel.journal.lines())[-1]["detail"]["sentence"]


def test_the_next_load_is_scanned_while_one_runs_and_survives_a_restart(
    make: Callable[..., Panel], reseated: str
) -> None:
    page = Page(make(reseated), "operator")
    for serial in ("SN0001", "SN0002"):
        page.do("scan", serial=serial)
    page.do("start")
    mark = page.wait_for_question()
    assert page.shown("waiting") == {}, "what is in work waits no more"
    assert page.do("scan", serial="SN0003") == {"told": "SN0003: A"}
    assert "listed twice" in page.do("scan", serial="SN0003")["error"]
    assert "tested in nest B" in page.do("scan", serial="SN0002")["error"]
    assert "in progress" in page.do("start")["error"]
    assert (page.nest("A")["serial"], page.nest("A")["next"]) == ("SN0001", "SN0003")
    # Another page process on the same log: the run goes on, and so does the list.
    again = Page(make(reseated), "operator")
    assert again.shown("waiting") == {"A": "SN0003"}
    again.do("confirm", question=mark)
    page.wait_for_end()
    shown = again.nest("A")
    assert (shown["serial"], shown["outcome"], shown["next"]) == ("SN0001", "PASS", "SN0003")
    assert not shown["scanned"], "the verdict stays while the unit is still in the nest"
    again.do("start")
    again.wait_for_question()
    assert (again.nest("A")["serial"], again.shown("waiting")) == ("SN0003", {})
    again.do("stop")
    again.wait_for_end()


def test_a_unit_that_passed_is_refused_and_an_engineer_takes_it_again_on_purpose(
    make: Callable[..., Panel], tmp_path: Path
) -> None:
    panel = make()
    fixture_run.run(tmp_path, ["SN0001"])
    operator, engineer = Page(panel, "operator"), Page(panel, "engineer")
    refused = operator.do("scan", serial="SN0001")
    assert "passed six-point on" in refused["error"]
    assert refused["again"] == "", "not the operator's to decide"
    assert "may not" in operator.do("again", serial="SN0001", reason="because")["error"]
    assert engineer.do("scan", serial="SN0001")["again"] == "SN0001"
    assert "3 to 200 printable" in engineer.do("again", serial="SN0001", reason=" ")["error"]
    assert panel.queue.waiting == {}
    assert engineer.do("again", serial="SN0001", reason="customer return 4711") == {"told": "SN0001: A"}
    last = list(panel.journal.lines())[-1]
    assert (last["person"], last["deed"], last["detail"]["reason"]) == ("engineer", "again", "customer return 4711")
    with SqliteLogReader(tmp_path / "station.db") as log:
        assert last["detail"]["passed"] == log.attempts(Query(serial="SN0001"))[0].attempt


def test_a_golden_unit_may_come_as_often_as_it_likes(
    make: Callable[..., Panel], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    register = Path("golden.json")
    config = fixture_run.config(tmp_path, golden={"file": str(register), "every_h": 8})
    fixture_run.run(tmp_path, ["SN0001"])
    page = Page(make(config=config), "operator")
    assert "passed" in page.do("scan", serial="SN0001")["error"]
    register.write_text(
        '{"units": [{"serial": "SN0001", "kind": "golden", "recipe": "six-point", "outcome": "PASS", '
        '"values": {}, "checks": [], "due": ""}]}'
    )
    assert page.do("scan", serial="SN0001") == {"told": "SN0001: A"}


def test_units_are_taken_up_again_in_the_nests_where_they_sit(make: Callable[..., Panel], tmp_path: Path) -> None:
    panel = make()
    page = Page(panel, "operator")
    panel.queue.put({"B": WaitingUnit("SN0002")})
    page.do("start")
    page.wait_for_end()
    with SqliteLogReader(tmp_path / "station.db") as log:
        assert [(a.serial, a.nest) for a in log.attempts(Query())] == [("SN0002", "B")]


def test_a_run_that_never_begins_gives_its_units_back(
    make: Callable[..., Panel], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    config = fixture_run.config(tmp_path, golden={"file": "none.json", "every_h": 8})
    page = Page(make(config=config), "operator")
    page.do("scan", serial="SN0001")
    page.do("start")
    page.wait_for_end()
    assert "golden register" in page.shown("fault")
    assert page.shown("waiting") == {"A": "SN0001"}
    assert page.nest("A")["serial"] == "SN0001"


def test_a_stop_ends_the_wait_and_its_units_do_not_mix_with_those_of_the_next_load(
    make: Callable[..., Panel], reseated: str
) -> None:
    page = Page(make(reseated), "operator")
    page.do("scan", serial="SN0001")
    page.do("start")
    page.wait_for_question()
    page.do("scan", serial="SN0002")
    page.do("stop")
    page.wait_for_end()
    assert page.nest("A")["outcome"] == "ABORTED", "a stop ends the wait for a person"
    assert page.shown("confirm") == {}
    assert page.do("resume") == {"told": "SN0001"}
    assert (page.nest("A")["serial"], page.nest("A")["scanned"]) == ("SN0001", True)
    assert page.shown("queue") == [["SN0002"]], "the next load waits behind those that are measured again"


def test_units_beyond_the_next_load_wait_in_a_queue_that_has_an_end(make: Callable[..., Panel]) -> None:
    page = Page(make(), "operator")
    nests = [nest.name for nest in page.panel.settings.nests]
    serials = [f"SN{number:04}" for number in range(1, 4 * len(nests) + 2)]
    for serial in serials[:-1]:
        assert "error" not in page.do("scan", serial=serial)
    assert "wait behind the next load" in page.do("scan", serial=serials[-1])["error"]
    assert page.shown("view")["state"] == "ready"
    assert [len(row) for row in page.shown("queue")] == [len(nests)] * 3
    first = serials[len(nests)]
    assert "listed twice" in page.do("scan", serial=first)["error"]
    page.do("take-out", serial=serials[0])
    assert page.shown("view")["turn"] == nests[0], "the queue moves up with a load, not into a nest by itself"
    assert page.do("scan", serial=first) == {"told": f"{first}: {nests[0]}"}
    page.do("start")
    page.wait_for_end()
    assert page.shown("waiting") == dict(zip(nests, serials[len(nests) + 1 : 2 * len(nests) + 1], strict=True))
