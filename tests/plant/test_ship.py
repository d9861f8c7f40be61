"""`station ship` and `station plant` as processes, over real sockets: tokens, certificates, outages, refusals."""

import http.client
import io
import json
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, redirect_stderr, redirect_stdout
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import pytest
from cryptography.hazmat.primitives import serialization
from prometheus_client.exposition import generate_latest

from station.cli.app import main
from station.config.settings import load_settings
from station.messages import Message, render
from station.ports.log_reader import Query
from station.web.metrics import gather
from station.web.panel import Panel
from station.web.run_launcher import LaunchOptions
from station.wiring.jobs import load_job
from station.wiring.shipping import read_statuses, shipping_in_background
from tests.fakes import logs
from tests.fakes.certificates import Authority
from tests.fakes.plant import FakeStation, Server

NewStation = Callable[..., FakeStation]


def station_command(*words: str | Path, check: bool = True) -> subprocess.CompletedProcess[str]:
    """The command in this process: a start takes a second of its own."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err), pytest.raises(SystemExit) as ended:
        main([str(word) for word in words])
    done = subprocess.CompletedProcess([*map(str, words)], int(ended.value.code or 0), out.getvalue(), err.getvalue())
    assert not check or done.returncode == 0, done.stderr
    return done


class Served:
    """A plant as a process of its own: started, killed and started again."""

    def __init__(self, folder: Path, address: str, tls: str = "") -> None:
        self.folder, self.port, self.address = folder, "0", address
        self.config = folder / "plant.yaml"
        self.config.write_text(
            f'schema: station.plant/1\ndatabase: "{address}"\nobjects: {folder / "objects"}\n{tls}', encoding="utf-8"
        )
        self.process: subprocess.Popen[str] | None = None

    def start(self) -> None:
        words = ["serve", "--config", str(self.config), "--port", self.port]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "station", "plant", *words], stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout
        self.url = self.process.stdout.readline().split()[2]
        self.port = self.url.rsplit(":", 1)[1]

    def kill(self) -> None:
        if self.process is not None:
            self.process.send_signal(signal.SIGKILL)
            self.process.communicate()
            self.process = None

    def get(self, path: str, token: str = "") -> tuple[int, bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", int(self.port), timeout=10)
        connection.request("GET", path, headers={"authorization": f"Bearer {token}"} if token else {})
        answer = connection.getresponse()
        found = answer.status, answer.read()
        connection.close()
        return found


@pytest.fixture
def served(server: Server, tmp_path: Path) -> Iterator[Served]:
    (tmp_path / "plant").mkdir()
    one = Served(tmp_path / "plant", server.database())
    yield one
    one.kill()


def public_key(station: FakeStation) -> Path:
    path = station.folder / f"{station.name}.pub"
    form = serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo
    path.write_bytes(station.key.public_key().public_bytes(*form))
    return path


def register(served: Served, station: FakeStation) -> Path:
    words = ("plant", "register", station.name, "--key", public_key(station), "--config", served.config)
    token = station.folder / f"{station.name}.token"
    token.write_text(station_command(*words).stdout.splitlines()[-1])
    return token


def station_config(station: FakeStation, *receivers: str) -> Path:
    path = station.folder / f"{station.name}.yaml"
    lines = "".join(f"  - {one}\n" for one in receivers)
    path.write_text(
        f"schema: station.config/1\nstation: {station.name}\nnests: [{{name: A, node: 1}}]\n"
        f"database: {station.path}\nreceivers:\n{lines}",
        encoding="utf-8",
    )
    return path


def test_ships_by_token_through_outages_and_kills_and_says_where_it_stands(
    served: Served, new_station: NewStation
) -> None:
    station = new_station(units=4)
    token = register(served, station)
    config = station_config(station, f"{{url: 'http://127.0.0.1:9', token_file: {token}}}")
    away = station_command("ship", "--once", "--config", config, check=False)
    assert (away.returncode, "away since" in away.stdout) == (3, True)
    assert f"at record 0, {len(station.records())} waiting" in away.stdout
    assert away.stdout.endswith("the plant cannot be reached: the connection was refused\n")
    served.start()
    config = station_config(station, f"{{url: '{served.url}', token_file: {token}, portion_bytes: 4096}}")
    shipped = json.loads(station_command("ship", "--once", "--json", "--config", config).stdout)["receivers"][0]
    assert (shipped["state"], shipped["number"]) == ("up-to-date", len(station.records()))
    with station.store() as store:
        logs.unit(store, "SN0100", station=station.name)
    served.kill()
    away = station_command("ship", "--once", "--config", config, check=False)
    assert away.returncode == 3
    served.start()
    assert "has every record" in station_command("ship", "--once", "--config", config).stdout
    assert "has every record" in station_command("ship", "--status", "--config", config).stdout
    status = json.loads(station_command("plant", "status", "--json", "--config", served.config).stdout)
    assert [(s["station"], s["number"]) for s in status["stations"]] == [("bench-1", len(station.records()))]
    assert station_command("plant", "verify", "--config", served.config).stdout.startswith("Every chain")
    assert served.get("/health")[0] == 200
    assert f'plant_records{{station="bench-1"}} {len(station.records())}.0' in served.get("/metrics")[1].decode()
    audit = json.loads(station_command("audit", "SN0100", "--json", "--db", served.address).stdout)
    assert [a["serial"] for a in audit["attempts"]] == ["SN0100"]


def test_who_brings_half_a_request_keeps_no_station_out(served: Served, new_station: NewStation) -> None:
    token = register(served, new_station(units=0)).read_text()
    served.start()
    half = b"POST /logs/a/records HTTP/1.1\r\nHost: plant\r\n"
    with ExitStack() as held:
        for _ in range(600):
            held.enter_context(socket.create_connection(("127.0.0.1", int(served.port)))).sendall(half)
        assert served.get("/health")[0] == 200
        with socket.create_connection(("127.0.0.1", int(served.port))) as cut:
            cut.sendall(half + f"Authorization: Bearer {token}\r\nContent-Length: 99\r\n\r\nstation".encode())
        status, said = served.get("/logs/a%00b", token)
    assert (status, json.loads(said)["refused"]["reason"]) == (400, "plant-no-portion")


def test_a_stranger_learns_and_changes_nothing(served: Served, new_station: NewStation) -> None:
    station = new_station()
    register(served, station)
    served.start()
    for token in ("", "guess"):
        status, body = served.get(f"/logs/{station.log_id()}", token)
        assert status == 401
        assert "register it in plant.yaml" in json.loads(body)["refused"]["sentence"]
    wrong = station.folder / "wrong.token"
    wrong.write_text("wrong")
    config = station_config(station, f"{{url: '{served.url}', token_file: {wrong}}}")
    refused = station_command("ship", "--once", "--config", config, check=False)
    assert refused.returncode == 1
    assert "The plant knows no station with this token" in refused.stdout


def test_two_plants_take_each_what_the_other_cannot(
    served: Served, server: Server, new_station: NewStation, tmp_path: Path
) -> None:
    station = new_station()
    token = register(served, station)
    served.start()
    config = station_config(
        station,
        f"{{name: near, url: '{served.url}', token_file: {token}}}",
        f"{{name: far, url: 'http://127.0.0.1:9', token_file: {token}}}",
    )
    found = json.loads(station_command("ship", "--once", "--json", "--config", config, check=False).stdout)["receivers"]
    assert [(s["receiver"], s["state"]) for s in found] == [("near", "up-to-date"), ("far", "away")]


def test_certificates_open_the_door_and_name_the_station(
    server: Server, new_station: NewStation, tmp_path: Path
) -> None:
    folder = tmp_path / "tls"
    folder.mkdir()
    authority = Authority(folder)
    own, own_key = authority.issue("plant")
    station = new_station()
    tls = (
        f"tls: {{certificate: {own}, key: {own_key}, authority: {authority.path}}}\n"
        f"stations:\n  - {{name: bench-1, public_key: {public_key(station)}, certificate: bench-one}}\n"
    )
    served = Served(folder, server.database(), tls)
    served.start()
    try:
        for name, code in (("bench-one", 0), ("stranger", 1)):
            certificate, key = authority.issue(name)
            config = station_config(
                station,
                f"{{url: '{served.url}', certificate: {certificate}, key: {key}, authority: {authority.path}}}",
            )
            assert station_command("ship", "--once", "--config", config, check=False).returncode == code
            (tmp_path / "bench-1.db.shipping.json").unlink()
        config = station_config(station, f"{{url: '{served.url}', authority: {authority.path}}}")
        assert station_command("ship", "--once", "--config", config, check=False).returncode == 3
        config = station_config(station, f"{{url: '{served.url}', certificate: {certificate}, key: {key}}}")
        away = station_command("ship", "--once", "--config", config, check=False)
        assert away.returncode == 3
        assert "check address, certificates and authority" in away.stdout
    finally:
        served.kill()


def test_a_restored_backup_is_parked_with_its_age_until_a_person_decides(
    served: Served, new_station: NewStation, tmp_path: Path
) -> None:
    station = new_station()
    saved = {file.name: file.read_bytes() for file in tmp_path.glob("bench-1.db*")}
    token = register(served, station)
    served.start()
    config = station_config(station, f"{{url: '{served.url}', token_file: {token}}}")
    with station.store() as store:
        logs.unit(store, "SN0100", station=station.name)
    station_command("ship", "--once", "--config", config)
    for file in tmp_path.glob("bench-1.db*"):
        file.unlink()
    for name, data in saved.items():
        (tmp_path / name).write_bytes(data)
    older = station_command("ship", "--once", "--config", config, check=False)
    assert (older.returncode, "now ends before record" in older.stdout) == (1, True)
    with station.store() as store:
        logs.unit(store, "SN0200", station=station.name)
    forked = station_command("ship", "--once", "--config", config, check=False)
    assert (forked.returncode, "differs from the one that the plant has" in forked.stdout) == (1, True)
    apart = station_command("plant", "status", "--config", served.config, check=False)
    assert (apart.returncode, apart.stdout.count("Set apart since")) == (1, 2)
    decided = ("--by", "Ada", "--reason", "the backup was put back by mistake", "--config", served.config)
    assert "stays out what was set apart, entries: 2." in station_command("plant", "reject", "bench-1", *decided).stdout
    assert "Set apart" not in station_command("plant", "status", "--config", served.config).stdout
    again = station_command("plant", "reject", "bench-1", *decided, check=False)
    assert (again.returncode, "waits for a decision" in again.stderr) == (3, True)
    forked = station_command("ship", "--once", "--config", config, check=False)
    assert (forked.returncode, "differs from the one that the plant has" in forked.stdout) == (1, True)
    words = ("plant", "adopt", "bench-1", "--by", "Ada", "--reason", "disk replaced", "--config", served.config)
    assert "is the log of bench-1" in station_command(*words).stdout
    assert "has every record" in station_command("ship", "--once", "--config", config).stdout
    from station.wiring.logs import open_log

    with open_log(served.address) as log:
        assert {a.serial for a in log.attempts(Query())} == {"SN0000", "SN0001", "SN0100", "SN0200"}
        assert list(log.findings()) == []


def test_the_page_ships_and_says_what_is_held_up_and_since_when(
    served: Served, new_station: NewStation, tmp_path: Path
) -> None:
    station = new_station()
    token = register(served, station)
    served.start()
    config = station_config(
        station,
        f"{{name: near, url: '{served.url}', token_file: {token}}}",
        f"{{name: far, url: 'http://127.0.0.1:9', token_file: {token}}}",
    )
    settings = load_settings(config)
    with (
        shipping_in_background(station.path, settings),
        shipping_in_background(station.path, settings),
    ):  # the second one yields
        until = time.monotonic() + 30
        while time.monotonic() < until:
            found = {s.receiver: s.state for s in read_statuses(station.path)}
            if found == {"near": "up-to-date", "far": "away"}:
                break
            threading.Event().wait(0.02)
    panel = Panel(
        settings, load_job("six-point")[0].recipe, LaunchOptions(station.path, "six-point", config, simulate=True),
        tmp_path / "accounts.json",
    )  # fmt: skip
    shown = render(Message.of(panel.screen.shown()["shipping"]))
    assert shown.startswith("far: away since 2")
    text = generate_latest(gather(panel)).decode()
    assert 'station_shipping_away{plant="far"} 1.0' in text
    assert 'station_shipping_behind_records{plant="near"} 0.0' in text


WRONG = {
    "actoin": (("plant", "actoin"), "has no action 'actoin'"),
    "no name": (("plant", "adopt"), "needs a name"),
    "no reason": (
        ("plant", "reject", "bench-1", "--by", "Ada"),
        "station plant reject bench-1 --by NAME --reason TEXT",
    ),
    "no config": (("plant", "status", "--config", "nowhere.yaml"), "nowhere.yaml"),
    "no receivers": (("ship",), "names no receivers"),
    "no database": (("audit", "SN1", "--db", "postgresql://127.0.0.1:9/x"), "cannot be read"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_input_is_one_sentence(case: str) -> None:
    words, expected = WRONG[case]
    done = station_command(*words, check=False)
    assert done.returncode == 2
    assert expected in done.stderr
    assert "Traceback" not in done.stderr


class AnyAnswer(BaseHTTPRequestHandler):
    """Something else that listens at the plant's address."""

    def do_GET(self) -> None:
        """Answers with a page."""
        self.send_response(404)
        self.send_header("content-length", "6")
        self.end_headers()
        self.wfile.write(b"<html>")

    def log_message(self, *_: object) -> None:
        """Says nothing."""


def test_what_is_no_plant_is_said_to_be_none(new_station: NewStation) -> None:
    station = new_station()
    with ThreadingHTTPServer(("127.0.0.1", 0), AnyAnswer) as other:
        Thread(target=other.serve_forever, daemon=True).start()
        config = station_config(station, f"{{url: 'http://127.0.0.1:{other.server_address[1]}'}}")
        away = station_command("ship", "--once", "--config", config, check=False)
        other.shutdown()
    assert away.returncode == 3
    assert "what answers there (404) is no plant: correct `url:` in config.yaml" in away.stdout
