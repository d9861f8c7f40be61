"""Inside: every report of the inner pytest goes out as one line of JSON."""

import json
from pathlib import Path

import pytest


class Reporter:
    """Writes reports to a file; opened and closed each time, so that a guest's page cache holds none back."""

    def __init__(self, config: pytest.Config, path: Path) -> None:
        self._config, self._path = config, path

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Hook: one phase of one test has a result."""
        data = self._config.hook.pytest_report_to_serializable(config=self._config, report=report)
        with self._path.open("a") as file:
            file.write(json.dumps(data) + "\n")
