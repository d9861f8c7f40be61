"""The page's doors: every route without log-in, with the wrong role, with a forged token, with too much in it."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest
from starlette.routing import Mount, Route
from starlette.testclient import TestClient

from station.config.settings import load_settings
from station.panel_protocol import accounts
from station.panel_protocol.accounts import RIGHTS, Account, Role
from station.ports.log_reader import Query
from station.web import audit
from station.web.app import create_app
from station.web.guard import MOST_BODY_BYTES
from station.web.panel import Panel
from station.web.run_launcher import LaunchOptions
from station.wiring.jobs import load_job
from tests.fakes import fixture_run
from tests.fakes.passwords import quick_hash

PASSWORD = "correct horse"
#: Routes that anybody may see; /metrics looks at the address instead.
OPEN = {"/login", "/health", "/metrics", "/light"}
#: Route → the right it asks for. A new route must be written down here.
NEEDS = {
    "/": "watch",
    "/events": "watch",
    "/plan": "watch",
    "/cards": "run",
    "/command": "run",
    "/logout": "watch",
    "/audit": "audit",
    "/audit/unit": "audit",
    "/audit/certificate": "audit",
    "/audit/certificate.pdf": "audit",
    "/audit/bundle": "audit",
    "/audit/recompute": "audit",
    "/audit/sign": "sign",
    "/audit/questions": "audit",
    "/charts": "charts",
    "/diagnose": "diagnose",
    "/diagnosis": "diagnose",
    "/diagnosis/report": "diagnose",
    "/diagnosis/changes": "diagnose",
    "/journal": "audit",
}


@dataclass
class Clock:
    """Seconds that pass when a test says so."""

    now_s: float = 1000.0

    def __call__(self) -> float:
        return self.now_s


@dataclass
class House:
    """A panel with three people and clients for them."""

    panel: Panel
    clock: Clock
    client: Callable[[], TestClient] = field(init=False)

    def __post_init__(self) -> None:
        app = create_app(self.panel)
        self.client = lambda: TestClient(app, follow_redirects=False)
        self.routes = [r for r in app.routes if isinstance(r, Route)]
        assert sum(isinstance(r, Mount) for r in app.routes) == 1, "only /static is mounted"

    def of(self, name: str) -> TestClient:
        """A client in which that person has logged in."""
        client = self.client()
        answer = client.post("/login", data={"name": name, "password": PASSWORD})
        assert answer.status_code == 303
        return client

    def csrf(self, client: TestClient) -> str:
        """The token of the client's session."""
        session = self.panel.sessions.find(client.cookies.get("station_session"))
        assert session is not None
        return session.csrf


@pytest.fixture(scope="module")
def people() -> dict[str, Account]:
    hashed = quick_hash(PASSWORD)
    return {role.value: Account(role.value, role, hashed) for role in Role}


@pytest.fixture
def house(tmp_path: Path, people: dict[str, Account]) -> Iterator[House]:
    accounts.save(tmp_path / "accounts.json", people)
    order = LaunchOptions(tmp_path / "station.db", "six-point", simulate=True)
    clock = Clock()
    job, _ = load_job("six-point")
    yield House(Panel(load_settings(), job.recipe, order, tmp_path / "accounts.json", monotonic_s=clock), clock)


def test_every_route_is_known_here(house: House) -> None:
    assert {r.path for r in house.routes} - OPEN <= set(NEEDS)


def test_nothing_is_seen_without_log_in(house: House) -> None:
    client = house.client()
    for route in house.routes:
        for method in (route.methods or set()) - {"HEAD"}:
            if route.path in OPEN:
                continue
            answer = client.request(method, route.path, data={} if method == "POST" else None)
            assert answer.status_code == 401, route.path
            page = client.get(route.path, headers={"accept": "text/html"}) if method == "GET" else None
            assert page is None or (page.status_code, page.headers["location"]) == (303, "/login")


@pytest.mark.parametrize("role", Role)
def test_nobody_does_what_is_not_theirs(house: House, role: Role) -> None:
    client = house.of(role.value)
    for route in house.routes:
        if route.path in OPEN | {"/events"} or role in RIGHTS[NEEDS[route.path]]:
            continue
        for method in (route.methods or set()) - {"HEAD"}:
            data = {"csrf": house.csrf(client), "action": "start"} if method == "POST" else None
            assert client.request(method, route.path, data=data).status_code == 403, route.path


def test_no_state_changes_by_get(house: House) -> None:
    client = house.of("engineer")
    for get in ("/command?action=start", "/logout"):
        assert client.get(get).status_code == 405
    for route in house.routes:
        assert (route.methods or set()) <= {"GET", "HEAD"} or (route.methods or set()) == {"POST"}


@pytest.mark.parametrize("token", ["", "forged", None])
def test_a_forged_or_missing_token_changes_nothing(house: House, token: str | None) -> None:
    client = house.of("operator")
    data = {"action": "scan", "serial": "SN0001"} | ({} if token is None else {"csrf": token})
    assert client.post("/command", data=data).status_code == 403
    assert client.post("/logout", data=data).status_code == 403
    other = house.of("operator")
    assert client.post("/command", data=data | {"csrf": house.csrf(other)}).status_code == 403, "another session's"
    assert house.panel.queue.waiting == {}


def test_a_form_from_another_site_is_refused(house: House) -> None:
    client = house.of("operator")
    data = {"action": "scan", "serial": "SN0001", "csrf": house.csrf(client)}
    for origin in ("https://evil.example", "null"):
        assert client.post("/command", data=data, headers={"origin": origin}).status_code == 403
    assert client.post("/command", data=data, headers={"origin": "http://testserver"}).status_code == 200


def test_bodies_that_are_too_large_or_of_no_length_are_not_read(house: House) -> None:
    client = house.of("operator")
    assert client.post("/command", content=b"x" * (MOST_BODY_BYTES + 1)).status_code == 413
    assert client.post("/login", content=iter([b"x" * 10])).status_code == 411
    assert client.put("/command", content=b"").status_code == 405


def test_a_script_in_a_serial_stays_text(house: House) -> None:
    client = house.of("operator")
    script = "<script>alert(1)</script>"
    data = {"action": "scan", "serial": script, "csrf": house.csrf(client)}
    answer = client.post("/command", data=data)
    assert answer.status_code == 409
    assert answer.headers["content-type"] == "application/json"
    assert house.panel.queue.waiting == {}
    page = client.post("/login", data={"name": script, "password": "x"}, headers={"accept": "text/html"})
    assert script not in page.text


def test_guessing_is_slow(house: House) -> None:
    client = house.client()
    for _ in range(5):
        assert client.post("/login", data={"name": "operator", "password": "guess"}).status_code == 401
    keys = ("name operator", "address testclient")
    assert house.panel.login_throttle.guessing(*keys)
    assert house.panel.login_throttle.delay_s(*keys) > 0
    assert client.post("/login", data={"name": "operator", "password": PASSWORD}).status_code == 303, (
        "the right one opens"
    )
    house.clock.now_s += 61
    assert not house.panel.login_throttle.guessing(*keys)


def test_a_browser_that_knows_the_person_is_no_guesser_whatever_others_guess(house: House) -> None:
    own, stranger = house.of("operator"), house.client()
    house.panel.login_throttle.most, house.panel.login_throttle.longest_delay_s = 1, 0.0
    stranger.post("/login", data={"name": "operator", "password": "guess"})
    house.panel.guesser_turns.most_waiting = 0  # as if as many tries of the guesser waited as may
    answer = stranger.post("/login", data={"name": "operator", "password": PASSWORD})
    assert (answer.status_code, "Too many log-ins" in answer.json()["error"]) == (429, True)
    assert own.post("/login", data={"name": "operator", "password": PASSWORD}).status_code == 303
    assert [line["deed"] for line in house.panel.journal.lines()].count("log-in-turned-away") == 1


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("bench-7", 200),
        ("BENCH-7:8080", 200),
        ("192.0.2.7:8080", 200),
        ("[::1]:8080", 200),
        ("evil.example", 421),
        ("", 421),
    ],
)
def test_only_the_pages_own_names_reach_it(house: House, host: str, status: int) -> None:
    app = create_app(replace_host_names(house.panel))
    assert TestClient(app).get("/login", headers={"host": host}).status_code == status


def replace_host_names(panel: Panel) -> Panel:
    """The same panel, reached as bench-7."""
    panel.host_names = frozenset({"bench-7"})
    return panel


def test_a_session_expires_and_ends_with_the_log_out(house: House) -> None:
    client = house.of("operator")
    house.clock.now_s += house.panel.sessions.idle_s + 1
    assert client.get("/").status_code == 401
    client = house.of("operator")
    cookie = client.cookies["station_session"]
    assert client.post("/logout", data={"csrf": house.csrf(client)}).status_code == 303
    client.cookies.set("station_session", cookie)
    assert client.get("/").status_code == 401


def test_answers_are_closed(house: House) -> None:
    client = house.client()
    for get in ("/login", "/static/panel.css", "/nowhere"):
        headers = client.get(get).headers
        assert "default-src 'none'" in headers["content-security-policy"]
        assert "unsafe" not in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["x-frame-options"] == "DENY"
        assert headers["cache-control"] == "no-store"
    answer = client.post("/login", data={"name": "operator", "password": PASSWORD})
    cookie = answer.headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie


def test_a_static_file_is_kept_by_the_browser_only_under_its_hash(house: House) -> None:
    client = house.client()
    page = client.get("/login", headers={"accept": "text/html"}).text
    (address,) = re.findall(r"/static/panel.css\?v=[0-9a-f]+", page)
    assert "immutable" in client.get(address).headers["cache-control"]
    for other in (address[:-1], "/static/panel.css?v=", "/static/panel.css?v=000000000000"):
        assert client.get(other).headers["cache-control"] == "no-store"


def test_static_files_stay_in_their_folder(house: House) -> None:
    client = house.client()
    for get in ("/static/../app.py", "/static/%2e%2e/app.py", "/static/..%2fapp.py"):
        assert client.get(get).status_code == 404


def test_deeds_carry_the_name_of_the_person(house: House) -> None:
    client = house.of("operator")
    client.post("/command", data={"action": "scan", "serial": "SN0001", "csrf": house.csrf(client)})
    client.post("/login", data={"name": "mallory", "password": "x"})
    lines = [(line["person"], line["deed"]) for line in house.panel.journal.lines()]
    assert lines == [("operator", "log-in"), ("operator", "scan"), ("mallory", "log-in-refused")]


def test_who_was_removed_or_given_another_role_is_out_at_once(house: House, people: dict[str, Account]) -> None:
    client, other = house.of("operator"), house.of("engineer")
    left = {name: account for name, account in people.items() if name != "operator"}
    accounts.save(house.panel.accounts, left)
    assert client.get("/").status_code == 401
    accounts.save(house.panel.accounts, left | {"engineer": replace(people["engineer"], role=Role.OPERATOR)})
    assert other.get("/audit").status_code == 401, "a right that was taken away is gone with the session"


def test_a_log_in_ends_the_session_that_the_browser_had(house: House) -> None:
    client = house.of("operator")
    first = client.cookies["station_session"]
    assert client.post("/login", data={"name": "engineer", "password": PASSWORD}).status_code == 303
    assert client.cookies["station_session"] != first
    assert not house.panel.sessions.open(first)


def test_a_cookie_that_somebody_else_chose_opens_nothing(house: House) -> None:
    client = house.client()
    client.cookies.set("station_session", "chosen-by-mallory")
    client.post("/login", data={"name": "operator", "password": PASSWORD})
    assert not house.panel.sessions.open("chosen-by-mallory")


def test_a_form_that_the_browser_says_is_foreign_is_refused(house: House) -> None:
    client = house.of("operator")
    data = {"action": "scan", "serial": "SN0001", "csrf": house.csrf(client)}
    for site in ("cross-site", "same-site"):
        assert client.post("/command", data=data, headers={"sec-fetch-site": site}).status_code == 403
    assert client.post("/command", data=data, headers={"sec-fetch-site": "same-origin"}).status_code == 200


def test_a_secure_page_has_secure_cookies(tmp_path: Path, people: dict[str, Account]) -> None:
    accounts.save(tmp_path / "accounts.json", people)
    job, _ = load_job("six-point")
    order = LaunchOptions(tmp_path / "station.db", "six-point", simulate=True)
    panel = Panel(load_settings(), job.recipe, order, tmp_path / "accounts.json", secure=True)
    client = TestClient(create_app(panel), follow_redirects=False)
    answer = client.post("/login", data={"name": "operator", "password": PASSWORD})
    assert "secure" in answer.headers["set-cookie"].lower()


def test_no_link_leads_to_another_site(house: House) -> None:
    client = house.client()
    for path in ("//evil.example/x", "/%5Cevil.example/x", "/\\evil.example", "/static//evil.example/"):
        page = client.get(f"http://testserver{path}", headers={"accept": "text/html"})
        links = re.findall(r"""(?:href|action|src)=["']([^"']*)""", page.text)
        assert not [link for link in links if re.match(r"[/\\\\]{2}|[a-z]+:(?!,)", link)], path


#: What people and programs put into addresses.
ODD = (
    *("size=\u00b2", "size=99999999999999999999", "size=-1", "size=", "value=%00", "since=0000-00-00", "since=9999"),
    *("before=\u0663", "before=" + "9" * 30, "serial=%F0%9F%98%80", "nest=" + "x" * 3000, "language=../../etc"),
)


def test_no_question_makes_the_page_stumble(house: House) -> None:
    fixture_run.run(house.panel.order.database.parent, ["SN0001"])
    client = house.of("engineer")
    for query in ODD:
        for at in ("/charts", "/audit", "/audit/unit", "/audit/certificate"):
            assert client.get(f"{at}?{query}").status_code in (200, 400), f"{at}?{query}"


def test_names_in_a_question_are_no_arguments(house: House) -> None:
    fixture_run.run(house.panel.order.database.parent, ["SN0001"])
    client = house.of("engineer")
    with house.panel.log() as log:
        (attempt,) = log.attempts(Query())
    requested = {"serial": "SN0001", "attempt": attempt.attempt, "person": "mallory", "deed": "x", "self": "y"}
    assert client.get("/audit/certificate", params=requested).status_code == 200
    last = list(house.panel.journal.lines())[-1]
    assert (last["person"], last["deed"]) == ("engineer", "certificate")
    client.get("/audit", params={"as": "text", "lot": "y" * 5000})
    assert list(house.panel.journal.lines())[-1]["detail"]["question"]["lot"] == "y" * 200


def test_headers_bear_no_serial_that_could_break_them() -> None:
    assert audit.file_name('SN"; x=\r\ny/../Ünit') == "certificate-SN___x___y_____nit.pdf"
