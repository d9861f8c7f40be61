"""Ed25519 by libsodium: a plant checks every record's signature, and OpenSSL's check takes 2.4 times as long."""

from station.errors import StoreFault

try:
    import nacl.bindings
    import nacl.exceptions
except ImportError as missing:
    raise StoreFault("plant-not-installed") from missing


def verify(key: bytes, signature: bytes, statement: bytes) -> bool:
    """Whether the signature over a statement is of that public key, 32 bytes."""
    if len(key) != nacl.bindings.crypto_sign_PUBLICKEYBYTES or len(signature) != nacl.bindings.crypto_sign_BYTES:
        return False
    try:
        nacl.bindings.crypto_sign_open(signature + statement, key)
    except nacl.exceptions.BadSignatureError:
        return False
    return True
