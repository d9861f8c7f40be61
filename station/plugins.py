"""Finds the one public class in each file of a package: the file's name, hyphened, is its id."""

import importlib
import inspect
import pkgutil
from functools import cache

from station.errors import UsageError


def names(package: str) -> tuple[str, ...]:
    """Ids of all plug-ins in `package` (dotted name), without importing them, in alphabetical order."""
    path = importlib.import_module(package).__path__
    found = (m.name for m in pkgutil.iter_modules(path) if not m.name.startswith("_"))
    return tuple(sorted(name.replace("_", "-") for name in found))


@cache
def load(package: str, name: str) -> type:
    """The public class of the plug-in `name`; UsageError lists the known names when there is none."""
    if name not in names(package):
        known = ", ".join(names(package))
        kind = package.rsplit(".", 1)[-1]
        raise UsageError(f"there is no {name!r} among the {kind}; the known ones are {known}")
    module = importlib.import_module(f"{package}.{name.replace('-', '_')}")
    classes = [
        value
        for key, value in vars(module).items()
        if inspect.isclass(value) and value.__module__ == module.__name__ and not key.startswith("_")
    ]
    if len(classes) != 1:
        listed = ", ".join(c.__name__ for c in classes) or "none"
        raise UsageError(f"{module.__name__} must hold exactly one public class, but holds {listed}")
    return classes[0]


def load_all(package: str) -> dict[str, type]:
    """Every plug-in of `package`, by id."""
    return {name: load(package, name) for name in names(package)}
