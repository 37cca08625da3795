"""Access control: only the browser of this machine that opened the address with the token, no page of another site.

- The host must be the loopback by name, so that no name of the web that leads here is answered (DNS rebinding).
- The token of the address is exchanged for a cookie that scripts cannot read and other sites cannot send.
- What changes something must come from this page by its ``Origin``; what another site asks for is refused by
  ``Sec-Fetch-Site`` too.
- Requests are bounded in size, also where they state none.
- Answers load nothing but scripts, styles and pictures of this address, and run no inline script.
"""

import secrets
from collections.abc import MutableMapping
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from typing import Any, Final

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

HOST: Final = "127.0.0.1"
LARGEST: Final = 210_000_000  # bytes of a request: a workbook of the largest size, and its form
START: Final = "/start/"
POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
HEADERS: Final = {
    "cache-control": "no-store",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
}
UNKNOWN: Final = "Open the address that 'fitmodels app' printed: it holds the token of this page."


class Guard:
    """Application that answers this machine's browser alone.

    Parameters
    ----------
    app : ASGI application
    port : int
    largest : int
        Bytes of a request.

    Attributes
    ----------
    token : str
        Of the address that is opened first.
    """

    def __init__(self, app: ASGIApp, port: int, largest: int = LARGEST) -> None:
        self.app, self.port, self.largest = app, port, largest
        self.token, self._secret = secrets.token_urlsafe(24), secrets.token_urlsafe(24)
        self.hosts = (f"{HOST}:{port}", f"localhost:{port}")
        self.cookie = f"fitmodels-{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        if scope["type"] != "http":
            return
        headers = Headers(scope=scope)
        status, words = self._refusal(scope, headers)
        if status is not None:
            await PlainTextResponse(words, status, HEADERS)(scope, receive, send)
        elif scope["path"].startswith(START):
            await self._enter(scope, receive, send)
        else:
            await self._answer(scope, receive, send)

    def _refusal(self, scope: Scope, headers: Headers) -> tuple[HTTPStatus | None, str]:
        """Status and words of a request that is refused, None of one that is not."""
        if headers.get("host") not in self.hosts:
            return HTTPStatus.MISDIRECTED_REQUEST, "This page is answered under the name of this machine alone."
        if headers.get("sec-fetch-site", "same-origin") not in ("same-origin", "none"):
            return HTTPStatus.FORBIDDEN, "Another site asked for this page."
        if scope["path"].startswith(START):
            token = scope["path"].removeprefix(START)
            known = secrets.compare_digest(token.encode("utf-8", "replace"), self.token.encode())
            return (None, "") if known and scope["method"] == "GET" else (HTTPStatus.FORBIDDEN, UNKNOWN)
        if not self._has_cookie(headers.get("cookie", "")):
            return HTTPStatus.FORBIDDEN, UNKNOWN
        if scope["method"] not in ("GET", "HEAD") and headers.get("origin") != f"http://{headers['host']}":
            return HTTPStatus.FORBIDDEN, "Only this page may change something."
        size = headers.get("content-length", "0")
        if not size.isdecimal() or int(size) > self.largest:
            return HTTPStatus.REQUEST_ENTITY_TOO_LARGE, self._too_large
        return None, ""

    @property
    def _too_large(self) -> str:
        return f"The file is larger than {self.largest / 1e6:.0f} MB: split it, or use 'fitmodels batch'."

    def _has_cookie(self, text: str) -> bool:
        try:
            found = SimpleCookie(text).get(self.cookie)
        except CookieError:
            return False
        return found is not None and secrets.compare_digest(found.value.encode(), self._secret.encode())

    async def _enter(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Exchange the token for the cookie."""
        answer = RedirectResponse("/", HTTPStatus.SEE_OTHER, HEADERS)
        answer.set_cookie(self.cookie, self._secret, httponly=True, samesite="strict", path="/")
        await answer(scope, receive, send)

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, bounded, and the answer with its policy."""
        read = 0

        async def bounded() -> Message:
            nonlocal read
            message = await receive()
            read += len(message.get("body", b""))
            if read > self.largest:
                raise HTTPException(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, self._too_large)
            return message

        async def guarded(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in {**HEADERS, "content-security-policy": POLICY}.items():
                    headers.setdefault(name, value)
            await send(message)

        await self.app(scope, bounded, guarded)
