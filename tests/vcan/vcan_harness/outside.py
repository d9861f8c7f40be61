"""Outside: the guest tests of a session run in one job; each shows as its own item.

The job starts with the session and runs beside the other tests. Where xdist deals tests out to processes, all guest
tests go to one of them (tests/schedule.py), and the job starts there with the first of them.
"""

import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from vcan_harness import cache, debian, peers, ways
from vcan_harness.job import Job

#: The key under which a worker of xdist hands its summary over, and how one begins that is bad news.
_SUMMARY, _NO_VCAN = "vcan", "NO VCAN"

GUEST_TESTS = Path(__file__).parent.parent / "guest"


def guest_items(session: pytest.Session) -> list[pytest.Item]:
    """The items of this session that belong inside."""
    return [item for item in session.items if item.path.is_relative_to(GUEST_TESTS)]


class Outside:
    """Stands between the outer pytest and the job. One per session."""

    def __init__(self) -> None:
        self._work: Path | None = None
        self._job: Job | None = None
        self._stream: Iterator[dict[str, Any]] = iter(())
        self._waiting: dict[str, list[dict[str, Any]]] = {}
        self._refusal = ""
        self.summary = ""

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item], config: pytest.Config) -> None:
        """Hook: a time-out counts inside, where the test runs; here it would count the boot as well."""
        if config.pluginmanager.hasplugin("timeout"):
            for item in items:
                if item.path.is_relative_to(GUEST_TESTS):
                    item.add_marker(pytest.mark.timeout(0), append=False)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> None:
        """Hook: prepares and starts the job, which then runs beside the other tests."""
        if not hasattr(session.config, "workerinput"):
            self._prepare(session)

    def _prepare(self, session: pytest.Session) -> None:
        items = guest_items(session)
        if not items or session.config.option.collectonly or session.testsfailed:
            return
        started = time.monotonic()
        reporter = session.config.pluginmanager.get_plugin("terminalreporter")
        if reporter and not (cache.folder() / "node").is_dir():
            reporter.write_line(f"vcan: fetching programs into {cache.folder()}, once; this takes a minute or two")
        self._work = cache.fresh_folder()
        try:
            self._start(session.config, self._work, [item.nodeid for item in items])
        except debian.Unavailable as error:
            self._refusal = str(error)
            self.summary = f"{_NO_VCAN}: {len(items)} tests FAIL unrun. {error}"
        else:
            self.summary += f", {len(items)} tests, prepared in {time.monotonic() - started:.1f} s"

    def _start(self, config: pytest.Config, work: Path, tests: list[str]) -> None:
        readable = (config.rootpath, Path(sys.prefix), Path(sys.base_prefix), cache.folder())
        way = ways.find(work, readable)
        variables = peers.provide()
        (work / "tests.txt").write_text("\n".join(tests))
        pytest_itself = [sys.executable, "-m", "pytest", f"--rootdir={config.rootpath}", "-p", "no:cacheprovider"]
        options = ["--color=no", "-o", "faulthandler_timeout=100"]
        if config.inipath:
            options += ["-c", str(config.inipath)]
        self.summary = f"on {way.name}"
        self._job = Job(way, work, config.rootpath, [*pytest_itself, *options, f"@{work / 'tests.txt'}"], variables)
        self._stream = self._job.reports()

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> bool | None:
        """Hook: for an inner test, waits for its reports instead of running it."""
        if not item.path.is_relative_to(GUEST_TESTS):
            return None
        if self._work is None:
            self._prepare(item.session)
        hook = item.ihook
        hook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
        for data in self._results(item.nodeid) or [self._lost(item)]:
            report = item.config.hook.pytest_report_from_serializable(config=item.config, data=data)
            hook.pytest_runtest_logreport(report=report)
        hook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
        return True

    def _results(self, nodeid: str) -> list[dict[str, Any]]:
        """The reports of one test, setup to teardown; empty when it never finished."""
        while not any(data["when"] == "teardown" for data in self._waiting.get(nodeid, ())):
            data = next(self._stream, None)
            if data is None:
                return []
            self._waiting.setdefault(data["nodeid"], []).append(data)
        return self._waiting.pop(nodeid)

    def _lost(self, item: pytest.Item) -> dict[str, Any]:
        """A failed report for a test that the job gave none for."""
        why = self._refusal
        if self._job:
            why = f"The inner run gave no result of this test. Its last words:\n{self._job.last_words()}"
        report = pytest.TestReport(item.nodeid, item.location, {}, "failed", why, "call")
        data: dict[str, Any] = item.config.hook.pytest_report_to_serializable(config=item.config, report=report)
        return data

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        """Hook of xdist: what the process that had the guest tests says of them."""
        self.summary = getattr(node, "workeroutput", {}).get(_SUMMARY, "") or self.summary

    def pytest_sessionfinish(self, session: pytest.Session, exitstatus: int) -> None:
        """Hook: ends the job and leaves nothing of it behind."""
        if hasattr(session.config, "workeroutput"):
            session.config.workeroutput[_SUMMARY] = self.summary
        if self._job:
            self._job.stop(0.0 if exitstatus == pytest.ExitCode.INTERRUPTED else 5.0)
        if self._work:
            shutil.rmtree(self._work)

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Hook: says where the vcan tests ran, or loudly that they could not."""
        if self.summary:
            terminalreporter.section("vcan", red=self.summary.startswith(_NO_VCAN), bold=True)
            terminalreporter.line(self.summary, red=self.summary.startswith(_NO_VCAN))
