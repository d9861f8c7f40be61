"""UDS (ISO 14229-1) as requests and answers: 0x22, 0x2E, 0x10, 0x27, 0x31, 0x11 and 0x3E. Frames are the transport's.

udsoncan builds the requests and takes the answers apart; what an answer belongs to is judged here, strictly.
"""

from collections.abc import Callable, Generator, Mapping

from udsoncan.BaseService import BaseService
from udsoncan.Request import Request
from udsoncan.Response import Response
from udsoncan.ResponseCode import ResponseCode
from udsoncan.services.DiagnosticSessionControl import DiagnosticSessionControl
from udsoncan.services.ECUReset import ECUReset
from udsoncan.services.ReadDataByIdentifier import ReadDataByIdentifier
from udsoncan.services.RoutineControl import RoutineControl
from udsoncan.services.SecurityAccess import SecurityAccess
from udsoncan.services.TesterPresent import TesterPresent
from udsoncan.services.WriteDataByIdentifier import WriteDataByIdentifier

from station.adapters.object_access.request import Answer, ObjectRefusal, ObjectRequest, Pending
from station.domain.product.uds_codes import data_identifier, negative_response

#: Makes the key of a security level from its seed.
SeedKey = Callable[[int, bytes], bytes]
Address = tuple[int, int]

_PENDING = ResponseCode.RequestCorrectlyReceived_ResponsePending


class UdsProtocol:
    """routines: objects whose writing is the start of a routine, by its number; numbers: objects whose bytes are turned
    round on the wire, most significant first; key: None where nothing is locked."""

    def __init__(
        self,
        *,
        session: int = 3,
        pending_s: float = 5.0,
        routines: Mapping[Address, int] | None = None,
        numbers: frozenset[Address] = frozenset(),
        level: int = 1,
        key: SeedKey | None = None,
    ) -> None:
        self.pending_s = pending_s
        self._session, self._routines, self._numbers = session, dict(routines or {}), numbers
        self._level, self._key = level, key

    def read(self, index: int, sub: int) -> ObjectRequest | None:
        """ReadDataByIdentifier."""
        did = data_identifier(index, sub)
        if did is None:
            return None
        turn = -1 if (index, sub) in self._numbers else 1
        return _request(ReadDataByIdentifier, None, _word(did), turn=turn)

    def write(self, index: int, sub: int, data: bytes) -> ObjectRequest | None:
        """WriteDataByIdentifier, or RoutineControl: start."""
        if (routine := self._routines.get((index, sub))) is not None:
            return _request(RoutineControl, RoutineControl.ControlType.startRoutine, _word(routine))
        did = data_identifier(index, sub)
        if did is None:
            return None
        more = data[::-1] if (index, sub) in self._numbers else data
        return _request(WriteDataByIdentifier, None, _word(did), more)

    def reset(self) -> ObjectRequest:
        """ECUReset: hard."""
        return _request(ECUReset, ECUReset.ResetType.hardReset)

    def alive(self) -> ObjectRequest:
        """TesterPresent."""
        return _request(TesterPresent, 0)

    def unlocking(self) -> Generator[ObjectRequest, bytes, None]:
        """The session, then seed and key; a seed of zeros says that nothing is locked."""
        yield _request(DiagnosticSessionControl, self._session)
        if self._key is None:
            return
        seed = yield _request(SecurityAccess, self._level)
        if any(seed):
            yield _request(SecurityAccess, self._level + 1, more=self._key(self._level, seed))


def _request(
    service: type[BaseService],
    subfunction: int | None,
    echoed: bytes = b"",
    more: bytes = b"",
    *,
    turn: int = 1,
) -> ObjectRequest:
    """A request whose positive answer begins with its sub-function and what it echoes. turn: −1 where the rest of the
    answer comes in the opposite order of bytes."""
    head = (b"" if subfunction is None else bytes([subfunction])) + echoed
    payload = Request(service, subfunction=subfunction, data=echoed + more).get_payload()

    def judge(data: bytes) -> Answer:
        response = Response.from_payload(data)
        if not response.valid or response.service is not service:
            return None
        if response.code == _PENDING:
            return Pending()
        if not response.positive:
            return ObjectRefusal(int(response.code or 0), negative_response(int(response.code or 0)))
        found = bytes(response.data or b"")
        return found[len(head) :][::turn] if found.startswith(head) else None

    return ObjectRequest(payload, judge)


def _word(number: int) -> bytes:
    return number.to_bytes(2, "big")


def uds_written(data: bytes) -> tuple[int, int] | None:
    """The data identifier or routine that a request begins to write or start; (0, 0) for a reset; None for neither.

    data: of a single or first frame (ISO 15765-2).
    """
    start = {0: 1, 1: 2}.get(data[0] >> 4) if data else None
    if start is None or len(data) <= start:
        return None
    service, rest = data[start], data[start + 1 :]
    if service == ECUReset.request_id():
        return 0, 0
    if service == WriteDataByIdentifier.request_id():
        return int.from_bytes(rest[:2], "big"), 0
    return (int.from_bytes(rest[1:3], "big"), 0) if service == RoutineControl.request_id() else None
