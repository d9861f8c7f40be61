"""Style sheets and scripts: each under an address that holds its content's hash, so that a browser asks for it once."""

import hashlib
from functools import cache
from pathlib import Path
from typing import Any

from starlette.responses import Response
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

FOLDER = Path(__file__).parent / "static"
_DIGITS = 12


@cache
def static_address(name: str) -> str:
    """`/static/NAME?v=HASH`."""
    return f"/static/{name}?v={hashlib.sha256((FOLDER / name).read_bytes()).hexdigest()[:_DIGITS]}"


class HashedFiles(StaticFiles):
    """Files of the folder; one that is asked for by its hash may be kept for a year."""

    def __init__(self) -> None:
        super().__init__(directory=FOLDER)

    def file_response(self, full_path: Any, stat_result: Any, scope: Scope, status_code: int = 200) -> Response:
        """Starlette's answer, with how long it may be kept."""
        answer = super().file_response(full_path, stat_result, scope, status_code)
        query = scope.get("query_string", b"").decode("latin-1")
        if query and static_address(Path(full_path).name).endswith(f"?{query}"):
            answer.headers["Cache-Control"] = "private, max-age=31536000, immutable"
        return answer
