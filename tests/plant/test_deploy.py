"""`deploy/`: what compose starts are commands that exist with files that hold, each with a check of its health."""

import hashlib
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

from station.cli.app import commands
from station.config.plant import load_plant
from station.config.settings import load_settings
from station.wiring.shipping import client_of

DEPLOY = Path(__file__).parents[2] / "deploy"
COMPOSE = yaml.safe_load((DEPLOY / "compose.yaml").read_text(encoding="utf-8"))
SERVICES = COMPOSE["services"]


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the folder, prepared twice."""
    folder = tmp_path_factory.mktemp("deploy") / "deploy"
    shutil.copytree(DEPLOY, folder)
    for _ in range(2):
        subprocess.run(["sh", folder / "prepare.sh"], check=True, capture_output=True)
    return folder


def test_every_service_has_a_healthcheck_and_starts_again() -> None:
    assert set(SERVICES) == {"postgresql", "plant", "panel", "scheduler", "worker"}
    assert SERVICES["worker"]["deploy"]["replicas"] == 2
    for name, service in SERVICES.items():
        assert service["healthcheck"]["test"], name
        assert service["restart"] == "unless-stopped", name
        for port in service.get("ports", ()):
            assert port.startswith("127.0.0.1:"), "nothing is open to the network unless somebody decides so"


def test_commands_options_and_files_exist() -> None:
    for name in ("plant", "panel"):
        words = SERVICES[name]["command"]
        assert words[0] in commands()
        shown = subprocess.run(
            [sys.executable, "-m", "station", words[0], "--help"], capture_output=True, text=True, check=True
        ).stdout
        assert all(word in shown for word in words if word.startswith("--"))
        for word in words:
            if word.startswith("/config/"):
                assert (DEPLOY / "config" / word.removeprefix("/config/")).is_file()
    for service in SERVICES.values():
        if build := service.get("build"):
            assert (DEPLOY / build["context"] / build["dockerfile"]).is_file()
        mounted = [v.partition(":")[0] for v in service.get("volumes", ()) if not v.startswith(".")]
        assert set(mounted) <= set(COMPOSE["volumes"])
        assert set(service.get("secrets", ())) <= set(COMPOSE["secrets"])


@pytest.mark.parametrize("file", ["Dockerfile", "Dockerfile.dask"])
def test_an_image_copies_what_the_wheel_is_built_from(file: str) -> None:
    lines = re.findall(r"^COPY (.*) \S+$", (DEPLOY / file).read_text(), re.MULTILINE)
    copied = {part for line in lines for part in line.split()}
    assert all((DEPLOY.parent / part).exists() for part in copied)
    project = tomllib.loads((DEPLOY.parent / "pyproject.toml").read_text())
    included = project["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    needed = {
        "pyproject.toml",
        project["project"]["readme"],
        *project["project"]["license-files"],
        "station",
        *included,
    }
    assert copied == needed


def test_what_prepare_makes_fits_together_and_stays(prepared: Path) -> None:
    config = prepared / "config"
    text = (config / "plant.yaml").read_text()
    (config / "plant.yaml").write_text(text.replace("/config/", f"{config}/"))
    plant = load_plant(config / "plant.yaml")
    (station,) = plant.stations
    token = (config / "plant.token").read_text().strip()
    assert station.token_sha256 == hashlib.sha256(token.encode()).hexdigest()
    own = (config / "config.yaml").read_text().replace("/config/", f"{config}/")
    (config / "config.yaml").write_text(own)
    settings = load_settings(config / "config.yaml")
    assert settings.station == station.name
    assert settings.receivers[0].url == "http://plant:8443"
    client_of(settings.receivers[0]).close()
    password = (prepared / "secrets" / "database").read_text().strip()
    assert (prepared / "secrets" / "pgpass").read_text() == f"postgresql:5432:plant:plant:{password}\n"
    assert (config / "station.key").stat().st_mode & 0o077 == 0
