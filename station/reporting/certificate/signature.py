"""Enveloped XML signatures of certificates, by the optional package signxml."""

import importlib

from station.errors import UsageError


def sign(xml: bytes, key_pem: bytes, certificate_pem: bytes) -> bytes:
    """The document with its signature inside. Errors: UsageError where the package is not installed."""
    try:
        etree = importlib.import_module("lxml.etree")
        signxml = importlib.import_module("signxml")
    except ModuleNotFoundError as exc:
        raise UsageError("dcc-extra-missing") from exc
    root = etree.fromstring(xml)
    algorithm = "ecdsa-sha256" if b"EC PRIVATE" in key_pem or _is_elliptic(key_pem) else "rsa-sha256"
    signer = signxml.XMLSigner(method=signxml.methods.enveloped, signature_algorithm=algorithm)
    signed = signer.sign(root, key=key_pem, cert=certificate_pem.decode())
    return bytes(etree.tostring(signed, xml_declaration=True, encoding="utf-8"))


def _is_elliptic(key_pem: bytes) -> bool:
    from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    return isinstance(load_pem_private_key(key_pem, None), EllipticCurvePrivateKey)
