"""AUTOSAR end-to-end protection, profiles 1 and 2, for whole arrays of payloads.

Source: AUTOSAR "Specification of SW-C End-to-End Communication Protection Library" (SWS_E2E): profile 1, CRC-8
SAE J1850 (0x1D) whose start and end values cancel to 0x00; profile 2, CRC-8 0x2F with start and end 0xFF.
"""

from collections.abc import Iterable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from station.domain.can.sensor_layout import EndToEnd, SensorLayout
from station.errors import ProductError

Bytes = NDArray[np.uint8]


@cache
def crc_table(polynomial: int) -> Bytes:
    """CRC-8 of each single byte (256), most significant bit first, start 0, no final XOR."""
    crc = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        crc = np.where(crc & 0x80, (crc << 1) ^ polynomial, crc << 1)
    return crc.astype(np.uint8)


def crc8(columns: Iterable[Bytes], polynomial: int, start: int) -> Bytes:
    """CRC-8 (n) of messages given byte by byte: each column holds one byte of every message (n), or of all (1)."""
    step = crc_table(polynomial).tobytes()
    crc = np.array([start], np.uint8)
    for column in columns:  # bytes are looked up in half the time that numpy takes to index
        crc = np.frombuffer((crc ^ column).tobytes().translate(step), np.uint8)
    return crc


def checksum(data: Bytes, counter: NDArray[np.uint64], layout: SensorLayout, node: int) -> Bytes:
    """The CRC byte (n) that payloads (n, w) of a node ought to carry, by the layout's profile."""
    e2e = layout.map.e2e
    if e2e is None:
        raise ProductError("layout-without-e2e", dbc=layout.map.dbc)
    body = [data[:, byte] for byte in range(layout.sample.length) if byte != layout.crc_byte]
    if e2e.profile == "P02":
        secret = np.array(e2e.data_ids, np.uint8)[counter % np.uint64(16)]
        return crc8([*body, secret], 0x2F, start=0xFF) ^ np.uint8(0xFF)
    return crc8([*_head(e2e, e2e.data_id_of(node), counter), *body], 0x1D, start=0x00)


def nibble_ok(data: Bytes, layout: SensorLayout, node: int) -> NDArray[np.bool_]:
    """In mode nibble: whether bits 12–15 carry the data id's third nibble (n); in the other modes always True."""
    e2e = layout.map.e2e
    if e2e is None or e2e.profile != "P01" or e2e.mode != "nibble":
        return np.ones(len(data), bool)
    return np.asarray(data[:, 1] >> 4 == e2e.data_id_of(node) >> 8 & 0xF)


def _head(e2e: EndToEnd, data_id: int, counter: NDArray[np.uint64]) -> list[Bytes]:
    """What of the data id goes into profile 1's CRC, ahead of the payload: columns as `crc8` takes them."""
    low, high = np.array([data_id & 0xFF], np.uint8), np.array([data_id >> 8], np.uint8)
    if e2e.mode == "alt":  # low byte with even counters, high byte with odd ones
        return [np.where(counter % np.uint64(2) == 0, low, high)]
    return {"both": [low, high], "low": [low], "nibble": [low, np.zeros(1, np.uint8)]}[e2e.mode]
