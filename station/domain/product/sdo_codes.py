"""SDO abort codes (CiA 301, table 22) as sentences for a person, and how to tell which object they are about."""

from collections.abc import Mapping
from types import MappingProxyType

ABORT: Mapping[int, str] = MappingProxyType(
    {
        0x05030000: "the toggle bit did not alternate",
        0x05040000: "the transfer timed out",
        0x05040001: "it does not know the SDO command",
        0x05040002: "the block size is invalid",
        0x05040003: "a segment of a block has a wrong sequence number",
        0x05040004: "the block's CRC is wrong",
        0x05040005: "it is out of memory",
        0x06010000: "the object cannot be accessed in this way",
        0x06010001: "the object can only be written",
        0x06010002: "the object can only be read",
        0x06020000: "there is no such object",
        0x06040041: "the object cannot be mapped to a PDO",
        0x06040042: "the mapped objects are longer than a PDO",
        0x06040043: "the parameters contradict each other",
        0x06040047: "its insides contradict each other",
        0x06060000: "its hardware failed, as a worn-out flash does",
        0x06070010: "the length does not fit the object's type",
        0x06070012: "the value has too many bytes",
        0x06070013: "the value has too few bytes",
        0x06090011: "there is no such sub-index",
        0x06090030: "the value is outside its range",
        0x06090031: "the value is too high",
        0x06090032: "the value is too low",
        0x06090036: "the maximum is below the minimum",
        0x060A0023: "a resource is missing, such as an SDO connection",
        0x08000000: "of a general error",
        0x08000020: "the value cannot be taken over or stored; a wrong save signature says so too",
        0x08000021: "it is under local control",
        0x08000022: "its present state forbids it: it may be locked or busy",
        0x08000023: "it has no object dictionary",
        0x08000024: "it holds no data there",
    }
)


def address(index: int, sub: int) -> str:
    """An object's address as people write it: 0x2101:03."""
    return f"0x{index:04X}:{sub:02X}"


def meaning(code: int) -> str:
    """What an abort code says; an unknown one says that it is the maker's own."""
    return ABORT.get(code, "of a reason that only its maker knows")


def sentence(code: int, node: int, deed: str, index: int, sub: int) -> str:
    """One sentence: node 5 refused to take 0x2101:03: the value is too high (abort code 0x06090031)."""
    return f"node {node} refused to {deed} {address(index, sub)}: {meaning(code)} (abort code 0x{code:08X})"
