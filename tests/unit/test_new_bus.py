"""A bus in a file of its own is configured, checked and opened with no other file touched."""

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from station import plugins
from station.adapters.clock import SystemClock
from station.config.settings import load_config
from station.errors import ConfigError, UsageError
from station.wiring.buses import BUSES, bus_kind, open_bus
from station.wiring.positioners import positioner, refuse_numbers_for_real_units

FILE = '''
"""A gateway that carries CAN over something else."""

from station.domain.core.types import Frames
from station.domain.recipe.fields import Positive, StrictModel


class Gateway:
    """As a bus."""

    interface_of_kernel = False
    without_units = False

    class Settings(StrictModel):
        """How long a frame may take, s."""

        latency_s: Positive = 0.01

    @classmethod
    def on_a_wire(cls, _channel):
        """Real units may be behind it."""
        return True

    def __init__(self, channel, latency_s):
        self.name, self.latency_s = channel, latency_s

    @classmethod
    def open(cls, channel, _clock, settings):
        """The gateway at that address."""
        return cls(channel, settings.latency_s)
'''
CONFIG = """\
nests: [{name: A, node: 17}]
positioner: {kind: simulated}
bus:
  interface: gateway
  channel: 192.0.2.7
  latency_s: LATENCY
"""


@pytest.fixture
def gateway(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A folder more in the package of buses, with one file in it."""
    (tmp_path / "gateway.py").write_text(FILE, encoding="utf-8")
    package = importlib.import_module(BUSES)
    monkeypatch.setattr(package, "__path__", [*package.__path__, str(tmp_path)])
    monkeypatch.setattr("sys.dont_write_bytecode", True)
    importlib.invalidate_caches()
    yield
    plugins.load.cache_clear()
    sys.modules.pop(f"{BUSES}.gateway", None)
    vars(package).pop("gateway", None)


def config(folder: Path, latency: str) -> Path:
    """A config.yaml with this bus."""
    path = folder / "config.yaml"
    path.write_text(CONFIG.replace("LATENCY", latency))
    return path


@pytest.mark.usefixtures("gateway")
def test_it_is_opened_with_its_own_options(tmp_path: Path) -> None:
    settings, document = load_config(config(tmp_path, "0.5"))
    bus = open_bus(settings.bus, document, SystemClock())
    assert bus.name == "192.0.2.7"
    assert vars(bus)["latency_s"] == 0.5
    assert not bus_kind(settings.bus).interface_of_kernel


@pytest.mark.usefixtures("gateway")
def test_a_wrong_option_is_named_with_its_line(tmp_path: Path) -> None:
    settings, document = load_config(config(tmp_path, "soon"))
    with pytest.raises(ConfigError, match="line 6, key `latency_s`"):
        open_bus(settings.bus, document, SystemClock())


@pytest.mark.usefixtures("gateway")
def test_a_positioner_in_numbers_is_refused_on_it(tmp_path: Path) -> None:
    settings, document = load_config(config(tmp_path, "1"))
    built = positioner(settings, document, SystemClock())
    with pytest.raises(UsageError, match=r"192\.0\.2\.7 carries real units"):
        refuse_numbers_for_real_units(settings, built)
