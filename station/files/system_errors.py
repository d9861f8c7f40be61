"""The file system's complaints as messages, each with its remedy."""

import errno

from station.messages import Message, system_reason

_REASONS = {
    errno.ENOSPC: "log-disk-full",
    errno.EDQUOT: "log-disk-full",
    errno.EFBIG: "log-disk-full",
    errno.EROFS: "log-read-only",
    errno.EACCES: "log-no-permission",
    errno.EPERM: "log-no-permission",
    errno.ENOENT: "log-no-folder",
    errno.EISDIR: "log-is-folder",
    errno.ENOTDIR: "log-path-not-folder",
    errno.EIO: "log-disk-error",
}


def os_error_reason(exc: OSError) -> Message:
    """The system's complaint with its remedy."""
    known = _REASONS.get(exc.errno or 0)
    return Message(known) if known else system_reason(exc)
