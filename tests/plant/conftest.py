"""One PostgreSQL for all of these tests, from a wheel; each test has a database of its own."""

import io
import tempfile
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
from cryptography.hazmat.primitives import serialization

from station.cli.app import main
from tests.fakes import logs
from tests.fakes.plant import FakePlant, FakeStation, Server


@pytest.fixture(scope="session")
def server() -> Iterator[Server]:
    # Not in pytest's folder, which every session shuts to all but its own user; PostgreSQL never runs as root.
    with tempfile.TemporaryDirectory(prefix="station-pg-", ignore_cleanup_errors=True) as folder:
        # Processes are killed here, the machine is not: a commit need not wait for the disk.
        one = Server(Path(folder), ("-c", "fsync=off", "-c", "full_page_writes=off"))
        one.start()
        yield one
        one.stop()


@pytest.fixture
def plant(server: Server, tmp_path: Path) -> Iterator[FakePlant]:
    made = FakePlant(server.database(), tmp_path / "objects")
    yield made
    made.connections.close()


@pytest.fixture
def new_station(tmp_path: Path) -> Callable[..., FakeStation]:
    """A station with so many finished units in its log."""

    def make(name: str = "bench-1", units: int = 2) -> FakeStation:
        station = FakeStation(name, tmp_path)
        with station.store() as store:
            for number in range(units):
                logs.unit(store, f"SN{number:04d}", station=name)
        return station

    return make


@pytest.fixture(scope="session")
def real_log(tmp_path_factory: pytest.TempPathFactory) -> FakeStation:
    """A signed log as a run writes it."""
    folder = tmp_path_factory.mktemp("real")
    one = FakeStation("bench-1", folder)
    pem = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    (folder / "key.pem").write_bytes(one.key.private_bytes(*pem))
    (folder / "config.yaml").write_text(
        f"schema: station.config/1\nstation: bench-1\nnests: [{{name: A, node: 17}}, {{name: B, node: 18}}]\n"
        f"database: {one.path}\nsigning_key: {folder / 'key.pem'}\n"
    )
    words = ["run", "--simulate", "--units", "2", "--seed", "3", "--config", str(folder / "config.yaml")]
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()), pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code in (0, None)
    return one
