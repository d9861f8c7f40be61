"""Runs tests/vcan/guest where a real kernel vcan exists; see README.md."""

import os
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from vcan_harness import job


def pytest_configure(config: pytest.Config) -> None:
    """Hook: inside, reports go out; outside, the inner tests' place is taken by their reports."""
    reports = os.environ.get(job.REPORTS)
    if reports:
        from vcan_harness.inside import Reporter

        config.pluginmanager.register(Reporter(config, Path(reports)), "vcan-inside")
    else:
        from vcan_harness.outside import Outside

        config.pluginmanager.register(Outside(), "vcan-outside")
