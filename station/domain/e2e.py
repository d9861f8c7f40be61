"""AUTOSAR end-to-end protection, profiles 1 and 2, for whole arrays of payloads.

Source: AUTOSAR "Specification of SW-C End-to-End Communication Protection Library" (SWS_E2E): profile 1, CRC-8
SAE J1850 (0x1D) whose start and end values cancel to 0x00; profile 2, CRC-8 0x2F with start and end 0xFF.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from station.domain.frames import EndToEnd, SensorLayout

Bytes = NDArray[np.uint8]


@cache
def table(polynomial: int) -> Bytes:
    """CRC-8 of each single byte (256), most significant bit first, start 0, no final XOR."""
    crc = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        crc = np.where(crc & 0x80, (crc << 1) ^ polynomial, crc << 1)
    return crc.astype(np.uint8)


def crc8(crc: Bytes, data: Bytes, polynomial: int) -> Bytes:
    """CRC-8 (n) of the rows of data (n, w), each going on from crc (n)."""
    step = table(polynomial)
    for column in range(data.shape[1]):
        crc = step[crc ^ data[:, column]]
    return crc


def checksum(data: Bytes, counter: NDArray[np.uint64], layout: SensorLayout, node: int) -> Bytes:
    """The CRC byte (n) that payloads (n, w) of a node ought to carry, by the layout's profile."""
    e2e = layout.map.e2e
    if e2e is None:
        raise ValueError("this layout has no end-to-end protection")
    body = np.delete(data[:, : layout.sample.length], layout.crc_byte, axis=1)
    if e2e.profile == "P02":
        secret = np.array(e2e.data_ids, np.uint8)[counter % np.uint64(16)]
        crc = crc8(np.full(len(data), 0xFF, np.uint8), body, 0x2F)
        return crc8(crc, secret[:, None], 0x2F) ^ np.uint8(0xFF)
    head = _head(e2e, e2e.data_id_of(node), counter)
    return crc8(crc8(np.zeros(len(data), np.uint8), head, 0x1D), body, 0x1D)


def nibble_right(data: Bytes, layout: SensorLayout, node: int) -> NDArray[np.bool_]:
    """In mode nibble: whether bits 12–15 carry the data id's third nibble (n); in the other modes always True."""
    e2e = layout.map.e2e
    if e2e is None or e2e.profile != "P01" or e2e.mode != "nibble":
        return np.ones(len(data), bool)
    return np.asarray(data[:, 1] >> 4 == e2e.data_id_of(node) >> 8 & 0xF)


def _head(e2e: EndToEnd, data_id: int, counter: NDArray[np.uint64]) -> Bytes:
    """What of the data id goes into profile 1's CRC, ahead of the payload (n, 1 or 2)."""
    low, high = data_id & 0xFF, data_id >> 8
    if e2e.mode == "alt":  # low byte with even counters, high byte with odd ones
        return np.where(counter % 2 == 0, low, high).astype(np.uint8)[:, None]
    chosen = {"both": [low, high], "low": [low], "nibble": [low, 0]}[e2e.mode]
    return np.tile(np.array(chosen, np.uint8), (len(counter), 1))
