"""Packages hidden from an import are not there inside, and are as ever outside."""

import importlib
import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

from station.optional_imports import hide_packages


def test_a_hidden_package_is_not_installed_inside_and_is_outside() -> None:
    with hide_packages("tabnanny"), pytest.raises(ImportError):
        importlib.import_module("tabnanny")
    assert "tabnanny" not in sys.modules
    assert importlib.util.find_spec("tabnanny") is not None


def test_what_is_loaded_stays_loaded() -> None:
    with hide_packages("pytest"):
        assert importlib.import_module("pytest") is pytest
    assert sys.modules["pytest"] is pytest


def test_a_failed_import_leaves_nothing_hidden() -> None:
    with pytest.raises(ZeroDivisionError), hide_packages("tabnanny"):
        raise ZeroDivisionError
    assert "tabnanny" not in sys.modules


#: Every way of the samples: written, looked through for the order of its units, read, and read in portions.
TABLES = """
import sys
from pathlib import Path
import numpy as np
from station.adapters.samples.reading import units_contiguous
from station.domain.core.types import Labels, SampleTable
from station.wiring.sample_files import read_samples, write_samples
name = Labels(("A", "B"), np.array([0, 1], np.int32))
table = SampleTable(name, np.zeros(2, int), np.zeros(2, int), name, np.zeros(2), np.zeros((2, 3)), {"nest": name}, {})
for path in (Path(sys.argv[1]) / "samples.csv", Path(sys.argv[1]) / "samples.parquet"):
    write_samples(table, path)
    assert units_contiguous(path)
    assert list(read_samples(path).labels["nest"].text()) == ["A", "B"]
print(*sorted({"asammdf", "matplotlib", "pandas"} & set(sys.modules)))
"""
#: A product's frames.
FRAMES = """
import sys
from station.wiring.jobs import check_product
check_product("accelerometer")
print(*sorted({"asammdf", "matplotlib", "pandas", "pyarrow"} & set(sys.modules)))
"""


@pytest.mark.parametrize("script", [TABLES, FRAMES])
def test_tables_and_frames_load_no_table_library(script: str, tmp_path: Path) -> None:
    """A start that loads pandas takes twice as long."""
    command = [sys.executable, "-c", script, str(tmp_path)]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.split() == []
