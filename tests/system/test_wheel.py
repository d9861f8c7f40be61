"""The built package runs without the repository: recipes, products and config.yaml travel in it."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that holds the wheel's content, as a site-packages would."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "-w", str(folder)]
    subprocess.run([*build, str(ROOT)], check=True, capture_output=True, text=True, timeout=110)
    (wheel,) = folder.glob("*.whl")
    site = folder / "site"
    with zipfile.ZipFile(wheel) as packed:
        packed.extractall(site)
    return site


def run(site: Path, folder: Path, *args: str) -> subprocess.CompletedProcess[str]:
    # First on the path, and far from the repository: an editable install must not answer in its place.
    program = f"import sys; sys.path.insert(0, {str(site)!r}); import station; " \
              f"assert station.__file__.startswith({str(site)!r}); " \
              "from station.cli.app import main; main(sys.argv[1:])"  # fmt: skip
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    return subprocess.run(
        [sys.executable, "-c", program, *args],
        cwd=folder, env=environment, capture_output=True, text=True, timeout=100, check=False,
    )  # fmt: skip


def test_a_run_needs_nothing_but_the_package(installed: Path, tmp_path: Path) -> None:
    done = run(installed, tmp_path, "run", "--simulate", "--units", "1")
    assert (done.returncode, done.stderr) == (0, "")
    assert "✔ PASS" in done.stdout
    assert (tmp_path / "station.db").exists()


def test_every_command_travels_too(installed: Path, tmp_path: Path) -> None:
    from station.cli.app import commands

    done = run(installed, tmp_path, "--help")
    assert all(f"  {name} " in done.stdout for name in commands())


def test_what_is_shipped_is_in_the_package(installed: Path) -> None:
    data = installed / "station" / "data"
    for folder in ("recipes", "dbc"):
        assert {p.name for p in (data / folder).iterdir()} == {p.name for p in (ROOT / folder).iterdir()}
    assert (data / "config.yaml").read_bytes() == (ROOT / "config.yaml").read_bytes()
