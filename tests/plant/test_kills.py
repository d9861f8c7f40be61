"""A short form of tests/endurance/torture_plant.py: whatever is killed, every record arrives once and in order."""

from pathlib import Path

from tests.endurance.torture_plant import VICTIMS, torture
from tests.fakes.plant import Server

SEED = 20260101


def test_nothing_is_lost_twice_or_out_of_order_whatever_is_killed(tmp_path: Path) -> None:
    import tempfile

    with tempfile.TemporaryDirectory(prefix="station-pg-", ignore_cleanup_errors=True) as folder:
        server = Server(Path(folder))
        server.start()
        try:
            done = torture(server, tmp_path, 2 * len(VICTIMS), 1, SEED)
        finally:
            server.stop()
    assert done["records"] > 20, done
    wrong = {n: done[n] for n in ("lost", "twice", "out of order", "altered", "set apart", "findings") if done[n]}
    assert wrong == {}, done
