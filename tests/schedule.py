"""How xdist deals the tests out: file by file, so that what a file prepares is prepared once.

All tests that share one thing, such as the guest kernel with its vcan, go to one process. What shares nothing and lasts
long goes test by test, wherever there is room.
"""

from xdist.scheduler import LoadScopeScheduling

#: Files and folders whose tests share something that is started or computed once: the guest kernel, a PostgreSQL, what
#: a diagnosis makes of chance alone, the syntax trees of the package.
TOGETHER = {
    "tests/vcan/": "vcan",
    "tests/plant/": "plant",
    "tests/blind/": "diagnosis",
    "tests/conformance/test_signatures.py": "diagnosis",
    "tests/conformance/test_degenerate.py": "diagnosis",
    "tests/conformance/test_languages.py": "source",
    "tests/unit/test_messages.py": "source",
    "tests/unit/test_names.py": "source",
}
#: Where the tests share nothing, and last long.
APART = ("tests/browser/test_shift.py",)
#: What lasts longest begins first, so that no process sits at the end with one long file alone.
FIRST = (*TOGETHER, "tests/browser/", "tests/system/test_torture.py", "tests/integration/", "tests/system/")


def piece_of_work(nodeid: str) -> str:
    """The file, or the name in TOGETHER, to which a test belongs; one of APART is a piece by itself."""
    if nodeid.startswith(APART):
        return nodeid
    shared = (name for start, name in TOGETHER.items() if nodeid.startswith(start))
    return next(shared, nodeid.split("::", 1)[0])


def rank(nodeid: str) -> int:
    """Where a test's piece of work stands among those that begin first."""
    return next((i for i, start in enumerate(FIRST) if nodeid.startswith(start)), len(FIRST))


class ByFile(LoadScopeScheduling):  # type: ignore[misc]  # xdist publishes no types
    """Pieces of work in the order in which they were collected."""

    def _split_scope(self, nodeid: str) -> str:
        """What goes to one process as a whole."""
        return piece_of_work(nodeid)
