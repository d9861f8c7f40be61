"""Rigs by name: `rigs/<name>.yaml`, checked."""

from pathlib import Path

from station.config.documents import load_document, validate
from station.config.search_path import find_file
from station.domain.rig.rig_map import RigMap
from station.errors import ConfigError


def rig_path(name: str) -> Path:
    """The file of a rig: a path, or a name that is searched here and as shipped."""
    return Path(name) if name.endswith((".yaml", ".yml")) else find_file(f"{name}.yaml", "rigs", None, ConfigError)


def load_rig(name: str) -> RigMap:
    """The rig of that name or path. Errors: ConfigError with every mistake, its line and remedy."""
    return validate(load_document(rig_path(name), ConfigError), RigMap, ConfigError)
