"""The server of the page on the loopback."""

import os
import socket
import threading
import webbrowser
from collections.abc import Callable
from contextlib import suppress

import uvicorn

from ..core.errors import UsageError
from ..core.files import cause
from ..datasets.vocabulary import ROLES
from .guard import HOST, START, Guard
from .jobs import Runner
from .page import Page
from .project import Project
from .reading import units_of


def serve(project: Project, run: Runner, port: int = 0, opened: Callable[[str], object] = print) -> None:
    """Serve the page of a project on the loopback until it is interrupted.

    Parameters
    ----------
    project : Project
    run : callable
        Runs the words of a command in a process of its own and returns its exit code; a function of a module.
    port : int
        0: a free one.
    opened : callable
        Called with the address once it is served.

    Raises
    ------
    UsageError
        The port is taken.
    """
    sock = listening(port)
    page = Page(project, run)
    port = sock.getsockname()[1]
    guard = Guard(page.application(), port)
    config = uvicorn.Config(
        guard, log_level="critical", access_log=False, lifespan="off", ws="none", server_header=False,
        timeout_graceful_shutdown=2,
    )  # fmt: skip
    page.jobs.start(["--version"])  # imports the package in the server of processes
    threading.Thread(target=_units, daemon=True).start()
    opened(f"http://{HOST}:{port}{START}{guard.token}")
    try:
        with suppress(KeyboardInterrupt):
            uvicorn.Server(config).run(sockets=[sock])
    finally:
        page.jobs.close()
        sock.close()


def listening(port: int) -> socket.socket:
    """A socket that is bound to a port of the loopback; 0: a free one.

    Raises
    ------
    UsageError
        The port is taken.

    >>> with listening(0) as sock:
    ...     sock.getsockname()[0]
    '127.0.0.1'
    """
    made = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if os.name == "posix":  # on Windows, two servers could share a port then
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        made.bind((HOST, port))
        made.listen()
    except (OSError, OverflowError) as failure:
        made.close()
        reason = cause(failure) if isinstance(failure, OSError) else "a port is a number up to 65535"
        raise UsageError(f"--port {port}: {reason}; give another one, or none.") from None
    return made


def _units() -> None:
    """Look up the units of all roles, while the browser opens."""
    for symbol in ROLES:
        units_of(symbol)


def open_browser(address: str) -> bool:
    """Open an address in the browser of this machine; False where there is none."""
    try:
        return webbrowser.open(address)
    except webbrowser.Error:
        return False
