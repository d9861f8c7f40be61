"""Portions on Dask distributed: on the processors of this machine, or on a cluster at an address.

Portions are submitted by their keys, so that a cluster computes the same work once. A worker that is killed costs what
it was computing: the scheduler gives that to another one. Each task compares its code with the coordinator's, so that a
worker that joins late is checked, too.
"""

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack
from itertools import islice
from types import TracebackType
from typing import Any, Self

from station.errors import InputError, StationFault
from station.files.code_version import code_version
from station.ports.fleet import Columns, Portion

try:
    import dask
    from distributed import Client, Future, KilledWorker, LocalCluster, Security, as_completed
    from distributed.client import FutureCancelledError
    from distributed.comm.addressing import get_address_host_port
except ImportError as missing:
    raise InputError("fleet-not-installed") from missing

#: A worker of this machine waits beyond 80 % of so much memory and is started anew beyond 95 %.
WORKER_MEMORY = 2 << 30
#: Portions at the scheduler at a time: what a large cluster has to do for minutes, and little memory.
IN_FLIGHT = 256
_CONNECT_S = 15
_LAST_PORT = 65535
#: What a local cluster does without. Dask samples itself for a dashboard, which is not there: a fifth of the
#: processor's time; and has its workers give memory back at once, for the next portion to get it page by page: a tenth.
_FRUGAL = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.scheduler.http.routes": [],
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 32 << 20,
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": 4 << 20,
}


class DaskEngine:
    """address: of a scheduler, tcp://… or tls://…; "": so many worker processes of this machine.

    Errors: StationFault where the cluster does not answer; InputError where it runs other code or the address is none.
    """

    def __init__(self, address: str = "", workers: int = 1) -> None:
        self._address, self._open = address, ExitStack()
        self._where = address or "127.0.0.1"
        refuse_no_address(address)
        with ExitStack() as opening:
            settings = {"distributed.comm.timeouts.connect": f"{_CONNECT_S}s", **({} if address else _FRUGAL)}
            opening.enter_context(dask.config.set(settings))
            try:
                cluster = None if address else opening.enter_context(_local_cluster(workers))
                self._client = opening.enter_context(Client(cluster or address, set_as_default=False))
            except (OSError, TimeoutError, ValueError) as error:
                raise StationFault("cluster-silent", address=self._where, why=_reason(error)) from error
            self._refuse_other_code()
            self._open = opening.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, tb: TracebackType | None, /
    ) -> None:
        self._open.close()

    def compute(self, function: Callable[[Any], Columns], portions: Iterable[Portion]) -> Iterator[tuple[str, Columns]]:
        """See PortionEngine.compute. What is under way is given up when the caller stops reading."""
        left = iter(portions)
        first = [self._submit(function, portion) for portion in islice(left, IN_FLIGHT)]
        running = set(first)
        done = as_completed(first, loop=self._client.loop)
        try:
            for future in done:
                yield future.key, self._result(future)
                running.discard(future)
                for portion in islice(left, 1):
                    running.add(following := self._submit(function, portion))
                    done.add(following)
        finally:
            # Released, not cancelled: a cancelled key takes with it whoever else wants that portion, also the next run.
            done.clear()
            for future in running:
                future.release()
            if self._client.status == "running":
                self._client.sync(_after_what_is_due)

    def _submit(self, function: Callable[[Any], Columns], portion: Portion) -> Future:
        return self._client.submit(_compute_checked, code_version(), function, portion.work, key=portion.key)

    def _result(self, future: Future) -> Columns:
        try:
            found: Columns = future.result()
            return found
        except KilledWorker as error:
            raise StationFault("cluster-portion-kills", portion=future.key) from error
        except (FutureCancelledError, OSError) as error:
            raise StationFault("cluster-lost", address=self._where, why=_reason(error)) from error
        except ImportError as error:
            raise InputError("cluster-other-code", own=code_version(), other=_reason(error)) from error

    def _refuse_other_code(self) -> None:
        try:
            self._client.wait_for_workers(1, timeout=_CONNECT_S)
            found: Mapping[str, str] = self._client.run(code_version)
        except (OSError, TimeoutError) as error:
            raise StationFault("cluster-without-workers", address=self._where) from error
        except (ImportError, AttributeError, TypeError, ValueError, RuntimeError) as error:
            # Another version of the package, or none, may fail in any of these ways.
            raise InputError("cluster-other-code", own=code_version(), other=_reason(error)) from error
        for version in found.values():
            _refuse_other(code_version(), version)


def refuse_no_address(address: str) -> None:
    """Before a client is made: one whose address has no port waits for half a minute and ends in a traceback.

    Errors: InputError.
    """
    try:
        port = get_address_host_port(address)[1] if address else 1
    except ValueError:
        port = 0
    if not 0 < port <= _LAST_PORT:
        raise InputError("cluster-no-address", address=address)


async def _after_what_is_due() -> None:
    """Ends when the client's loop has done all that it was given before: a key that is asked for next is a new one."""


def _compute_checked(code: str, function: Callable[[Any], Columns], work: Any) -> Columns:
    """At a worker."""
    _refuse_other(code, code_version())
    return function(work)


def _refuse_other(own: str, other: str) -> None:
    if own != other:
        raise InputError("cluster-other-code", own=own, other=other)


def _local_cluster(workers: int) -> LocalCluster:
    """Encrypted with keys of its own: nobody else on the machine may hand it code. There is no dashboard, but the
    scheduler listens for one all the same: on this machine alone, at any port, so that two clusters do not meet."""
    return LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        memory_limit=WORKER_MEMORY,
        dashboard_address="127.0.0.1:0",
        silence_logs=logging.CRITICAL,
        security=Security.temporary(),
    )


def _reason(error: BaseException) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
