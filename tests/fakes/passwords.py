"""Accounts whose log-in costs a test nothing."""

import base64
import hashlib


def quick_hash(password: str) -> str:
    """A stored password in the form of `accounts.hash_password`, at a small cost: the station reads that
    from the hash."""
    salt = bytes(16)
    key = hashlib.scrypt(password.encode(), salt=salt, n=64, r=8, p=1, dklen=64)
    return f"scrypt$64$8$1${base64.b64encode(salt).decode()}${base64.b64encode(key).decode()}"
