"""Two callers at once: on one node they take turns, on two nodes neither waits for the other's answers."""

import threading
from collections.abc import Callable

from station.adapters.canopen.network import ServiceNetwork
from station.adapters.canopen.sdo_client import SdoClient
from tests.fakes.echo_channel import AddressObjects, EchoChannel

READS = 1000


def hammer(jobs: list[Callable[[], object]]) -> list[BaseException]:
    """Runs the jobs in threads of their own; what they raised."""
    raised: list[BaseException] = []

    def guarded(job: Callable[[], object]) -> None:
        try:
            job()
        except BaseException as exc:  # noqa: BLE001 - a thread's failure is the test's result
            raised.append(exc)

    threads = [threading.Thread(target=guarded, args=(job,)) for job in jobs]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert not any(thread.is_alive() for thread in threads)
    return raised


def reader(sdo: SdoClient, index: int) -> Callable[[], None]:
    def read() -> None:
        for i in range(READS):
            sub = i % 250
            assert sdo.upload(index, sub) == AddressObjects().read(index, sub)

    return read


def test_two_threads_on_one_node_never_get_each_others_answers() -> None:
    channel = EchoChannel([5])
    sdo = SdoClient(ServiceNetwork(channel, channel), 5, 5.0)
    assert hammer([reader(sdo, 0x2000), reader(sdo, 0x3000)]) == []
    assert sdo.dropped == 0


def test_threads_on_different_nodes_share_one_channel() -> None:
    nodes = (5, 6, 7)
    channel = EchoChannel(nodes)
    network = ServiceNetwork(channel, channel)
    clients = [SdoClient(network, node, 5.0) for node in nodes]
    assert hammer([reader(sdo, 0x3000) for sdo in clients]) == []
    assert [sdo.dropped for sdo in clients] == [0, 0, 0]
