"""The page's files, read once at start: no request opens a file. Each answer's headers forbid everything that the page
does not need."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from websockets.datastructures import Headers
from websockets.http11 import Response

FOLDER = Path(__file__).parent / "static"
SOCKET = "socket"  # name of the socket, in each place
TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/json; charset=utf-8",
    ".svg": "image/svg+xml",
}
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self' {socket}; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
    "Cache-Control": "no-store",
}


class Files:
    """Answers for paths of the page. server: its address, ws://… or wss://…

    fronts: which file is the page of a place, "/" or "/robot/NAME/". Every place has the same other files. A page may
    connect to the socket in its own place, and to nothing else.
    """

    def __init__(self, server: str, fronts: Mapping[str, str], folders: Sequence[Path] = (FOLDER,)) -> None:
        self._server = server
        self._fronts = dict(fronts)
        self._files = {
            str(path.relative_to(folder)): (path.read_bytes(), TYPES[path.suffix])
            for folder in folders
            for path in folder.rglob("*")
            if path.suffix in TYPES
        }

    def answer(self, path: str) -> Response:
        """The file of this path, or 404."""
        path = path.partition("?")[0]
        place = max((place for place in self._fronts if path.startswith(place)), key=len, default="/")
        name = path.removeprefix(place) or self._fronts.get(place, "")
        if name not in self._files:
            return self.refuse(404, "Not Found", "there is no such file here\n")
        body, kind = self._files[name]
        return self._response(200, "OK", body, kind, place)

    def refuse(self, status: int, phrase: str, sentence: str) -> Response:
        return self._response(status, phrase, sentence.encode(), "text/plain; charset=utf-8")

    def _response(self, status: int, phrase: str, body: bytes, kind: str, place: str = "/") -> Response:
        policy = POLICY.format(socket=f"{self._server}{place}{SOCKET}")
        headers = Headers({**HEADERS, "Content-Security-Policy": policy})
        headers.update({"Content-Type": kind, "Content-Length": str(len(body)), "Connection": "close"})
        return Response(status, phrase, headers, body)
