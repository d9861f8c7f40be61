"""The operating system's refusals as messages: by their number, so that every language has them."""

import errno

from station.messages.message import Message

#: getaddrinfo(3) numbers its refusals apart: EAI_NONAME, EAI_AGAIN, EAI_FAIL, EAI_NODATA, EAI_FAMILY, EAI_ADDRFAMILY.
_NO_SUCH_HOST = (-2, -3, -4, -5, -6, -9)
_REASONS = {
    errno.ENOENT: "system-no-such-file",
    errno.EACCES: "system-no-permission",
    errno.EPERM: "system-no-permission",
    errno.EISDIR: "system-is-folder",
    errno.ENOTDIR: "system-not-folder",
    errno.EEXIST: "system-exists",
    errno.ENOSPC: "system-disk-full",
    errno.EDQUOT: "system-disk-full",
    errno.EFBIG: "system-disk-full",
    errno.EROFS: "system-read-only",
    errno.EIO: "system-disk-error",
    errno.ENAMETOOLONG: "system-name-too-long",
    errno.ELOOP: "system-link-loop",
    errno.ESTALE: "system-file-exchanged",
    errno.EMFILE: "system-too-many-files",
    errno.ENFILE: "system-too-many-files",
    errno.EPIPE: "system-pipe-closed",
    errno.EADDRINUSE: "system-address-in-use",
    errno.EADDRNOTAVAIL: "system-no-such-address",
    errno.ECONNREFUSED: "system-refused-connection",
    errno.ETIMEDOUT: "system-timed-out",
    errno.ENETUNREACH: "system-no-route",
    errno.EHOSTUNREACH: "system-no-route",
    errno.ENETDOWN: "system-no-route",
    errno.ECONNRESET: "system-connection-broken",
    errno.ECONNABORTED: "system-connection-broken",
    errno.EINVAL: "system-not-acceptable",
    errno.EBUSY: "system-busy",
    errno.ETXTBSY: "system-busy",
    errno.ENODEV: "system-no-such-device",
    errno.ENXIO: "system-no-such-device",
    errno.ESPIPE: "system-not-ordinary",
    **dict.fromkeys(_NO_SUCH_HOST, "system-no-such-host"),
}


def system_reason(error: OSError | UnicodeError) -> Message:
    """Why the system refused, as a part of a sentence: "the disk is full". UnicodeError: of a host's name that can be
    none, such as one with an empty part."""
    if isinstance(error, UnicodeError):
        return Message("system-no-such-host")
    if getattr(error, "library", None):  # of TLS, which counts its refusals in a table of its own
        return Message("system-tls", reason=getattr(error, "verify_message", "") or getattr(error, "reason", ""))
    if isinstance(error, TimeoutError):
        return Message("system-timed-out")
    id_ = _REASONS.get(error.errno or 0)
    return Message(id_) if id_ else Message.text(" ".join((error.strerror or str(error)).split()))
