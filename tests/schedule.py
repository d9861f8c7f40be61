"""How xdist deals the tests out: file by file, so that what a file prepares is prepared once.

All tests that share one thing of the machine (the guest kernel with its vcan) go to one process. What shares
nothing and lasts long goes test by test, wherever there is room.
"""

from xdist.scheduler import LoadScopeScheduling

#: Folders whose tests share something that is started once.
TOGETHER = ("tests/vcan", "tests/plant")
#: Where the tests share nothing, and last long.
APART = ("tests/browser/test_shift.py", "tests/blind/", "tests/conformance/test_signatures.py")
#: What lasts longest begins first, so that no process sits at the end with one long file alone.
FIRST = (*TOGETHER, "tests/browser", *APART, "tests/system/test_torture.py", "tests/integration", "tests/system")


def piece_of_work(nodeid: str) -> str:
    """The file, or the one of TOGETHER, to which a test belongs; one of APART is a piece by itself."""
    if nodeid.startswith(APART):
        return nodeid
    path = nodeid.split("::", 1)[0]
    return next((folder for folder in TOGETHER if path.startswith(f"{folder}/")), path)


def rank(nodeid: str) -> int:
    """Where a test's piece of work stands among those that begin first."""
    return next((i for i, start in enumerate(FIRST) if nodeid.startswith(start)), len(FIRST))


class ByFile(LoadScopeScheduling):  # type: ignore[misc]  # xdist publishes no types
    """Pieces of work in the order in which they were collected."""

    def _split_scope(self, nodeid: str) -> str:
        """What goes to one process as a whole."""
        return piece_of_work(nodeid)
