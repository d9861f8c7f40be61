"""The face of `station commission`."""

from typing import Any

from station.cli._confirm import wait_for_person
from station.cli._output import print_json, print_message, print_remark
from station.messages import Message, render
from station.service.commission import Commissioned
from station.wiring.commission import CommissionOrder, commission_fixture

SCHEMA = "station.commission/1"


def commission_and_print(order: CommissionOrder, *, json: bool) -> int:
    """Exit code 0 where every nest has its device, 1 where one is empty or a device is left over."""

    def tell(message: Message) -> None:
        if json:
            print_remark(render(message))
        else:
            print_message(message)

    found = commission_fixture(order, tell, wait_for_person)
    if json:
        print_json(_document(found))
    else:
        for finding in found.findings:
            print_remark(render(finding))
    return 0 if found.complete else 1


def _document(found: Commissioned) -> dict[str, Any]:
    devices = [
        {
            "nest": d.nest,
            "node": d.node,
            "how": d.how,
            "vendor": d.identity.vendor,
            "product": d.identity.product,
            "revision": d.identity.revision,
            "serial": d.identity.serial,
        }
        for d in found.devices
    ]
    return {
        "schema": SCHEMA,
        "complete": found.complete,
        "devices": devices,
        "findings": [render(m) for m in found.findings],
        "messages": [m.document() for m in found.findings],
    }
