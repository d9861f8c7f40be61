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
    """The file `name`: a path as it stands, else in `folder` around the file `near`, here, or as shipped.

    Errors: `error` naming the folders that were searched.
    """
    stands = Path(name)
    if stands.is_absolute() or stands.exists():
        return stands
    tried = list(dict.fromkeys(_folders(folder, near)))
    for place in tried:
        if (place / name).is_file():
            return place / name
    listed = ", ".join(str(p) for p in tried)
    raise error(f"there is no {name} here nor in {listed}; check the name")


def _folders(folder: str, near: Path | None) -> Iterable[Path]:
    if near is not None:
        yield near.parent
        yield near.parent / folder
        yield near.parent.parent / folder
    yield Path(folder)
    yield shipped_folder() / folder
