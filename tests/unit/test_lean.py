"""Packages hidden from an import are not there inside, and are as ever outside."""

import importlib
import importlib.util
import sys

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
