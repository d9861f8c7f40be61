"""Register maps as files: `cells/NAME.yaml`."""

from station.config.documents import load_document, validate
from station.config.search_path import find_file
from station.domain.cell.register_map import RegisterMap
from station.errors import ConfigError


def load_map(name: str) -> RegisterMap:
    """The register map of that path, or of that name in `cells/`. Errors: ConfigError with line, key and remedy."""
    file = name if name.endswith(".yaml") else f"{name}.yaml"
    return validate(load_document(find_file(file, "cells", None, ConfigError), ConfigError), RegisterMap, ConfigError)
