"""Finds the one public class in each file of a package: the file's name, hyphened, is its id."""

import importlib
import inspect
import pkgutil
from functools import cache

from station.errors import UsageError


def names(package: str) -> tuple[str, ...]:
    """Ids of all plug-ins in `package` (dotted name), without importing them, in alphabetical order."""
    return _in_folders(tuple(importlib.import_module(package).__path__))


@cache
def _in_folders(folders: tuple[str, ...]) -> tuple[str, ...]:
    """Ids of what lies in some folders; these are asked for at every model that is read, and at every cause of a bank,
    and no file comes while a process lives."""
    modules = (m.name for m in pkgutil.iter_modules(folders) if not m.name.startswith("_"))
    return tuple(sorted(name.replace("_", "-") for name in modules))


@cache
def load(package: str, name: str) -> type:
    """The public class of the plug-in `name`; UsageError lists the names when there is none."""
    if name not in names(package):
        raise UsageError("plugin-unknown", name=name, kind=package.rsplit(".", 1)[-1], names=names(package))
    module = importlib.import_module(f"{package}.{name.replace('-', '_')}")
    classes = [
        value
        for key, value in vars(module).items()
        if inspect.isclass(value) and value.__module__ == module.__name__ and not key.startswith("_")
    ]
    if len(classes) != 1:
        listed = [c.__name__ for c in classes]
        raise UsageError("plugin-classes", module=module.__name__, count=len(classes), classes=listed)
    return classes[0]


def load_all(package: str) -> dict[str, type]:
    """Every plug-in of `package`, by id."""
    return {name: load(package, name) for name in names(package)}
