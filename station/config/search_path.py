"""Where recipes, products and config.yaml are found: beside what names them, here, or as shipped."""

from collections.abc import Iterable
from pathlib import Path

import station
from station.errors import InputError

_PACKAGE = Path(station.__file__).parent


def shipped_folder() -> Path:
    """The folder that holds `recipes/`, `dbc/` and `config.yaml` as shipped: in the wheel, or in the repository."""
    packed = _PACKAGE / "data"
    return packed if packed.is_dir() else _PACKAGE.parent


def find_file(name: str, folder: str, near: Path | None, error: type[InputError]) -> Path:
    """The file `name`: a path as given, else in `folder` around the file `near`, here, or as shipped.

    Errors: `error` naming the folders that were searched.
    """
    given = Path(name)
    if given.is_absolute() or given.exists():
        return given
    folders = list(dict.fromkeys(_folders(folder, near)))
    for place in folders:
        if (place / name).is_file():
            return place / name
    raise error("no-such-file-in-folders", file=name, folders=[str(p) for p in (Path(), *folders)])


def _folders(folder: str, near: Path | None) -> Iterable[Path]:
    if near is not None:
        yield near.parent
        yield near.parent / folder
        yield near.parent.parent / folder
    yield Path(folder)
    yield shipped_folder() / folder
