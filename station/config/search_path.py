"""Where recipes, products and config.yaml are found: beside what names them, here, or as shipped."""

import re
from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

import station
from station.errors import InputError

#: Folder → the schema that its files do not have; so much of a file is read for it.
_OTHERS = {folder: re.compile(rb"[\"']?schema[\"']?\s*:\s*[\"']?station\." + kind + b"/")
           for folder, kind in (("dbc", b"recipe"), ("recipes", b"product"))}  # fmt: skip
_HEAD_BYTES = 4096
#: The gallery of published devices, among the products.
EXAMPLES = "examples"
_PACKAGE = Path(station.__file__).parent


def shipped_folder() -> Path:
    """The folder that holds `recipes/`, `dbc/` and `config.yaml` as shipped: in the wheel, or in the repository."""
    packed = _PACKAGE / "data"
    return packed if packed.is_dir() else _PACKAGE.parent


def find_file(name: str, folder: str, near: Path | None, error: type[InputError]) -> Path:
    """The file `name`: a path as given, else in `folder` around the file `near`, here, or as shipped.

    A file that says by its schema that it is another kind of document is passed over: a recipe and a product may have
    one name. Errors: `error` naming the folders that were searched, and the nearest name in them.
    """
    given = Path(name)
    if given.is_absolute() or ((given.is_symlink() or given.exists()) and not _is_other(given, folder)):
        return given
    folders = list(dict.fromkeys(_folders(folder, near)))
    for place in folders:
        if (place / name).is_file() and not _is_other(place / name, folder):
            return place / name
    searched = [str(p) for p in (Path(), *folders)]
    there = (path for place in folders if place.is_dir() for path in place.iterdir() if path.suffix == given.suffix)
    names = {path.stem for path in there if not _is_other(path, folder)}
    if close := get_close_matches(given.stem[:64], sorted(names), 1):
        raise error("no-such-file-near", file=name, folders=searched, nearest=close[0] + given.suffix)
    raise error("no-such-file-in-folders", file=name, folders=searched)


def _is_other(path: Path, folder: str) -> bool:
    """Whether a file is the other kind of document than that of the folder."""
    other = _OTHERS.get(folder)
    try:
        with path.open("rb") as file:
            return other is not None and other.search(file.read(_HEAD_BYTES)) is not None
    except OSError:
        return False


def _folders(folder: str, near: Path | None) -> Iterable[Path]:
    if near is not None:
        yield near.parent
        yield near.parent / folder
        yield near.parent.parent / folder
    yield Path(folder)
    yield shipped_folder() / folder
    if folder == "dbc":
        yield shipped_folder() / folder / EXAMPLES
