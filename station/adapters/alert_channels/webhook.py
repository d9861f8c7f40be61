"""An alert as a POST of JSON to an address of the plant's own choice."""

import http.client
import json
import urllib.error
import urllib.request
from collections.abc import Mapping
from typing import Any

_TIMEOUT_S = 10.0


class Webhook:
    """url: http:// or https://. Any answer of 2xx is a receipt."""

    def __init__(self, url: str) -> None:
        self._url = url
        # What follows the path may be a token.
        self.name = url.partition("?")[0]

    def send(self, document: Mapping[str, Any]) -> None:
        """See AlertChannel.send."""
        body = json.dumps(document, ensure_ascii=False, allow_nan=False).encode()
        headers = {"Content-Type": "application/json", "User-Agent": "can-calibration-station"}
        request = urllib.request.Request(self._url, body, headers, method="POST")
        try:
            with urllib.request.urlopen(request, timeout=_TIMEOUT_S):
                return
        except urllib.error.HTTPError as error:
            error.close()
            raise OSError(f"HTTP {error.code}") from error
        except http.client.HTTPException as error:
            raise OSError(type(error).__name__) from error
