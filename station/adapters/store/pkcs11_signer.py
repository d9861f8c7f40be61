"""The station's key in a hardware module (PKCS#11, CKM_EDDSA): it signs there and never leaves it.

    signing_key: "pkcs11:token=line;object=log"

The module's path stands in STATION_PKCS11_MODULE, its PIN in STATION_PKCS11_PIN. The form is that of RFC 7512, with
`token` and `object` alone.
"""

from typing import Any
from urllib.parse import unquote

from station.adapters.store.keys import Signer
from station.errors import ConfigError

SCHEME = "pkcs11:"


def open_signer(uri: str, module: str, pin: str) -> Signer:
    """The key `object` of the token `token`. Errors: ConfigError."""
    attributes = dict(part.partition("=")[::2] for part in uri.removeprefix(SCHEME).split(";"))
    token, label = unquote(attributes.get("token", "")), unquote(attributes.get("object", ""))
    if not token or not label:
        raise ConfigError("pkcs11-form", uri=uri)
    if not module:
        raise ConfigError("pkcs11-no-module", uri=uri)
    try:
        import pkcs11
        from pkcs11.exceptions import PKCS11Error
    except ImportError as error:
        raise ConfigError("pkcs11-not-installed", uri=uri) from error
    try:
        session = pkcs11.lib(module).get_token(token_label=token).open(user_pin=pin or None)
        private: Any = session.get_key(object_class=pkcs11.ObjectClass.PRIVATE_KEY, label=label)
        public: Any = session.get_key(object_class=pkcs11.ObjectClass.PUBLIC_KEY, label=label)
        point = bytes(public[pkcs11.Attribute.EC_POINT])[-32:]  # an OCTET STRING around the 32 bytes (RFC 8410)
    except (PKCS11Error, RuntimeError) as error:
        reason = str(error) or type(error).__name__
        raise ConfigError("pkcs11-refused", token=token, object=label, reason=reason) from error

    def sign(data: bytes) -> bytes:
        return bytes(private.sign(data, mechanism=pkcs11.Mechanism.EDDSA))

    return Signer(sign, point)
