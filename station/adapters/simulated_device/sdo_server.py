"""An SDO server: one transfer at a time, with every check and its abort code. Frames in, frames out.

Source: CiA 301 7.2.4.3. The transfers themselves are generators in `sdo_serving`. Pure: what objects hold and
what a write means is the business of `Objects`.
"""

from canopen.sdo import constants as sdo

from station.adapters.canopen.sdo_transfer import COMMAND_MASK, initiate_header
from station.adapters.simulated_device import sdo_serving
from station.adapters.simulated_device.object_server import SdoRequest
from station.adapters.simulated_device.sdo_serving import Objects, SdoAbort, Serving

_INITIATING_ANSWERS = (sdo.RESPONSE_UPLOAD, sdo.RESPONSE_DOWNLOAD)


class SdoServer:
    """Serves `objects`. A new transfer ends the one under way, as on most devices."""

    def __init__(self, objects: Objects) -> None:
        self._objects = objects
        self._serving: Serving | None = None
        self._current_request = SdoRequest(0, 0, "read", starts=False, segment=False)
        self._in_block = False

    def about(self, data: bytes) -> SdoRequest:
        """What a request is about, before it is handled."""
        if not self._starts(data):
            now = self._current_request
            return SdoRequest(now.index, now.sub, now.access, starts=False, segment=self._in_block)
        access = "read" if data[0] & COMMAND_MASK in (sdo.REQUEST_UPLOAD, sdo.REQUEST_BLOCK_UPLOAD) else "write"
        return SdoRequest(int.from_bytes(data[1:3], "little"), data[3], access, starts=True, segment=False)

    def handle(self, data: bytes) -> tuple[bytes, ...]:
        """The answers to one request of 8 bytes; none to an abort."""
        if data[0] == sdo.REQUEST_ABORTED:
            self.reset()
            return ()
        try:
            if self._starts(data):
                self._current_request = self.about(data)
                self._serving = self._begin(data)
                reply = next(self._serving)
            elif self._serving is None:
                raise SdoAbort(sdo.ABORT_INVALID_COMMAND_SPECIFIER)
            else:
                reply = self._serving.send(data)
        except StopIteration as done:
            self.reset()
            last: tuple[bytes, ...] = done.value
            return last
        except SdoAbort as abort:
            self.reset()
            return (self.abort(abort.code),)
        self._in_block = reply.segments_follow
        return reply.frames

    def abort(self, code: int) -> bytes:
        """An abort frame about the object of the last transfer."""
        return initiate_header(
            sdo.RESPONSE_ABORTED, self._current_request.index, self._current_request.sub
        ) + code.to_bytes(4, "little")

    def refuse(self, data: bytes, code: int) -> bytes:
        """Aborts what this request wants or belongs to, without serving it."""
        about = self.about(data)
        self.reset()
        self._current_request = about
        return self.abort(code)

    def reset(self) -> None:
        """Ends the transfer under way."""
        self._serving, self._in_block = None, False

    def wants_restart(self) -> bool:
        """SDO cannot ask for it."""
        return False

    def of_other_object(self, answer: bytes, index: int) -> bytes:
        """The same answer for another index, where it names one."""
        if answer[0] & COMMAND_MASK not in _INITIATING_ANSWERS:
            return answer
        return answer[:1] + (index & 0xFFFF).to_bytes(2, "little") + answer[3:]

    def of_next_object(self, answer: bytes) -> bytes:
        """The same answer as it would be to a request for the next sub-index."""
        return answer[:3] + bytes([(answer[3] + 1) & 0xFF]) + answer[4:]

    def _starts(self, data: bytes) -> bool:
        kind = data[0] & COMMAND_MASK
        if self._in_block:
            return False
        if kind == sdo.REQUEST_BLOCK_UPLOAD:
            return data[0] & 3 == sdo.INITIATE_BLOCK_TRANSFER
        if kind == sdo.REQUEST_BLOCK_DOWNLOAD:
            return data[0] & 1 == sdo.INITIATE_BLOCK_TRANSFER
        return kind in (sdo.REQUEST_UPLOAD, sdo.REQUEST_DOWNLOAD)

    def _begin(self, data: bytes) -> Serving:
        serve = {
            sdo.REQUEST_UPLOAD: sdo_serving.upload,
            sdo.REQUEST_DOWNLOAD: sdo_serving.download,
            sdo.REQUEST_BLOCK_UPLOAD: sdo_serving.block_upload,
            sdo.REQUEST_BLOCK_DOWNLOAD: sdo_serving.block_download,
        }[data[0] & COMMAND_MASK]
        return serve(self._objects, self._current_request.index, self._current_request.sub, data)
