"""The positioner that config.yaml names, with its own options checked."""

from typing import Any, TypeVar

from pydantic import BaseModel

from station import plugins
from station.adapters.clock import VirtualClock
from station.config.documents import Document, validate
from station.config.settings import Settings
from station.errors import ConfigError
from station.ports.clock import Clock
from station.ports.positioner import Positioner

POSITIONERS = "station.adapters.positioner"
Options = TypeVar("Options", bound=BaseModel)


def positioner(settings: Settings, document: Document, clock: Clock) -> Positioner:
    """Builds it. Errors: UsageError for an unknown kind, ConfigError for its options."""
    made: Any = plugins.load(POSITIONERS, settings.positioner.kind)
    options = options_of(settings, document, made.Settings)
    built: Positioner = made(options, clock)
    return built


def unused_positioner(settings: Settings, document: Document) -> Positioner:
    """The same for its estimates only: nothing is moved with it. Errors: UsageError, ConfigError."""
    return positioner(settings, document, VirtualClock())


def options_of(settings: Settings, document: Document, model: type[Options]) -> Options:
    """The positioner's own block of config.yaml, checked. Errors: ConfigError with line and key."""
    if not settings.positioner.options:
        return model()
    part = document.part("positioner")
    own = Document(part.path, settings.positioner.options, part.lines)
    return validate(own, model, ConfigError)
