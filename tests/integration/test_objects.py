"""Raw frames by their SHA-256 in a folder that somebody else can reach, too."""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from station.adapters.objects.store import FolderObjects, RemoteObjects
from station.errors import LogError

DATA = b"frames of a unit" * 100


def object_file(root: Path) -> Path:
    name = hashlib.sha256(DATA).hexdigest()
    path = root / name[:2] / name
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def of_zeros(path: Path) -> None:
    """As a power cut leaves a file whose length was on the disk and whose content was not."""
    path.write_bytes(bytes(len(DATA)))


def exchanged(path: Path) -> None:
    path.write_bytes(DATA[:-1] + b"?")


def a_link(path: Path) -> None:
    (path.parents[1] / "elsewhere").write_bytes(DATA)
    path.symlink_to(path.parents[1] / "elsewhere")


def a_link_to_nothing(path: Path) -> None:
    path.symlink_to(path.parents[1] / "nothing")


def a_pipe(path: Path) -> None:
    os.mkfifo(path)


@pytest.mark.parametrize("harm", [of_zeros, exchanged, a_link, a_link_to_nothing, a_pipe])
def test_what_bears_an_objects_name_and_is_something_else_is_replaced(
    tmp_path: Path, harm: Callable[[Path], None]
) -> None:
    harm(object_file(tmp_path))
    objects = FolderObjects(tmp_path)
    sha256 = objects.put(DATA)
    assert object_file(tmp_path).lstat().st_size == len(DATA)
    assert not object_file(tmp_path).is_symlink()
    assert objects.get(sha256) == DATA


@pytest.mark.parametrize("harm", [of_zeros, exchanged, a_link_to_nothing, a_pipe])
def test_what_bears_an_objects_name_and_is_something_else_is_not_read_as_it(
    tmp_path: Path, harm: Callable[[Path], None]
) -> None:
    harm(object_file(tmp_path))
    with pytest.raises(LogError):
        FolderObjects(tmp_path).get(hashlib.sha256(DATA).digest())


def test_an_object_at_an_address_is_replaced_where_it_is_another(tmp_path: Path) -> None:
    from fsspec.implementations.local import LocalFileSystem

    of_zeros(object_file(tmp_path))
    objects = RemoteObjects(LocalFileSystem(), str(tmp_path), "file://")
    assert objects.get(objects.put(DATA)) == DATA
