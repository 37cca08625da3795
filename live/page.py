"""The page of a watch on the loopback: the facts of the terminal view, renewed each second.

It is served to this machine alone, under an address with a random token, which programs of other users cannot guess. A
request must name the loopback as its host, so that no page of the web can read it under a name of its own. The page
loads nothing but its facts, and nothing can be changed by it: requests other than GET are refused.
"""

import secrets
import threading
from collections.abc import Callable, Sequence
from functools import lru_cache
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any, Final

from ..cards.forms.rendering import checksum
from ..core.errors import UsageError
from ..core.files import cause
from ..core.text import json_text, printable
from .facts import Facts, clock
from .view import life_words, load_words, risk_words, rows, wear_words

HOST: Final = "127.0.0.1"
POINTS: Final = 400  # of the curve of wear; every second one is left out beyond
SILENT: Final = 5.0  # s that a connection may be silent
ELSEWHERE: Final = ("wear", "", "life", "risk", "load")  # rows of the terminal that stand in other places of the page


@lru_cache(maxsize=1)
def page_and_policy() -> tuple[bytes, str]:
    """The page and its content security policy."""
    from jinja2 import Environment, StrictUndefined

    css, script, html = (
        files("fitmodels.live").joinpath("templates", f"watch.{kind}").read_text("utf-8")
        for kind in ("css", "js", "html")
    )
    made = Environment(autoescape=False, undefined=StrictUndefined)  # noqa: S701  assets of the package alone
    text = made.from_string(html).render(css=css, script=script)
    policy = (
        f"default-src 'none'; script-src 'sha256-{checksum(script)}'; style-src 'sha256-{checksum(css)}'; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    return text.encode(), policy


class _Handler(BaseHTTPRequestHandler):
    """Answers requests for the page and its facts."""

    server: "_Server"
    timeout = SILENT
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "fitmodels", ""

    def do_GET(self) -> None:
        """Send the page or the facts, to who names the loopback and knows the token."""
        port = self.server.server_address[1]
        if self.headers.get("Host") not in (f"{HOST}:{port}", f"localhost:{port}"):
            self._send(HTTPStatus.MISDIRECTED_REQUEST, b"", "text/plain")
            return
        token, slash, name = self.path.lstrip("/").partition("/")
        known = secrets.compare_digest(token.encode("latin-1", "replace"), self.server.token.encode())
        if not (known and slash) or name not in ("", "facts.json"):
            self._send(HTTPStatus.NOT_FOUND, b"", "text/plain")
        elif name == "facts.json":
            self._send(HTTPStatus.OK, self.server.content, "application/json")
        else:
            self._send(HTTPStatus.OK, page_and_policy()[0], "text/html; charset=utf-8")

    def _send(self, status: HTTPStatus, content: bytes, kind: str) -> None:
        self.send_response(status)
        headers = {
            "Content-Type": kind,
            "Content-Length": str(len(content)),
            "Content-Security-Policy": page_and_policy()[1],
            "Cache-Control": "no-store",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
        }
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_: object) -> None:
        """Print nothing."""


class _Server(ThreadingHTTPServer):
    """A server on the loopback with the facts of now."""

    daemon_threads = True
    request_queue_size = 16

    def __init__(self, port: int, token: str) -> None:
        self.token, self.content = token, b"{}"
        super().__init__((HOST, port), _Handler)

    def handle_error(self, *_: Any) -> None:  # noqa: ANN401
        """Print nothing: a reader that goes away is no fault of the watch."""


class Page:
    """The page of a watch, an outlet.

    Parameters
    ----------
    port : int
        0: a free one.

    Attributes
    ----------
    address : str
        With the token.

    Raises
    ------
    UsageError
        The port is taken.
    """

    def __init__(self, port: int = 0) -> None:
        token = secrets.token_urlsafe(16)
        try:
            self._server = _Server(port, token)
        except (OSError, OverflowError) as failure:
            reason = cause(failure) if isinstance(failure, OSError) else "a port is a number up to 65535"
            raise UsageError(f"--page {port}: {reason}; give another port, or none.") from None
        self.address = f"http://{HOST}:{self._server.server_address[1]}/{token}/"
        self._history: list[tuple[float, float, float | None, float | None]] = []
        self._edge = 0
        self._thread = threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True)
        self._thread.start()

    def show(self, facts: Facts) -> None:
        """Take the description of now."""
        self._remember(facts)
        self._server.content = json_text(described(facts, self._history)).encode()

    def report(self, facts: Callable[[], Facts], sentences: Sequence[str], _: float | None) -> None:
        """Show at once what is new."""
        if sentences:
            self.show(facts())

    def close(self) -> None:
        """Stop the server."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join(SILENT)

    def _remember(self, facts: Facts) -> None:
        """Add a point to the curve of wear; a new edge begins a new one."""
        if facts["edge"]["number"] != self._edge:
            self._edge, self._history = facts["edge"]["number"], []
        wear = facts["wear"]
        if wear["median"] is None or (self._history and self._history[-1][0] >= facts["cut_minutes"]):
            return
        self._history.append((facts["cut_minutes"], wear["median"], wear["low"], wear["high"]))
        if len(self._history) > POINTS:
            self._history = [*self._history[:-1:2], self._history[-1]]


def described(facts: Facts, history: Sequence[Sequence[float | None]]) -> Facts:
    """Facts with their words as the terminal has them, texts made printable, and the curve of wear."""
    words = {"wear": wear_words(facts["wear"]), "life": life_words(facts["life"]), "risk": risk_words(facts) or ""}
    return {
        **facts,
        "words": words,
        "rows": [(label, printable(text)) for label, text in rows(facts) if label not in ELSEWHERE],
        "load_words": {name: load_words(name, load) for name, load in facts["loads"].items()},
        "alarms": [{**one, "clock": clock(one["time"])} for one in facts["alarms"]],
        "advice": [{**one, "clock": f"since {clock(one['time'])}"} for one in facts["advice"]],
        "history": history,
    }
