"""A read-only OPC UA server with the estimates of a watch, for dashboards on the same machine.

It runs in a thread with an event loop of its own. All variables stand in the object ``fitmodels`` of the namespace
`NAMESPACE`, with string identifiers such as ``fitmodels.wear``; a value that is not known has a bad status.
"""

import asyncio
import contextlib
import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import urlsplit

from ..core.errors import FitmodelsError, UsageError
from ..core.text import json_text, printable
from .facts import Facts

if TYPE_CHECKING:
    from asyncua.common.node import Node
    from asyncua.server.server import Server

NAMESPACE: Final = "urn:fitmodels:watch"
LOOPBACK: Final = ("127.0.0.1", "localhost", "::1")
PORT: Final = 4841
EXTRA: Final = "--serve needs asyncua: pip install 'fitmodels[live]'."
STARTED: Final = 60.0  # s within which the server starts


def _of(*path: str) -> Callable[[Facts], Any]:
    def found(facts: Facts) -> Any:  # noqa: ANN401
        value: Any = facts
        for name in path:
            value = value.get(name) if isinstance(value, Mapping) else None
        return value

    return found


VALUES: Final[Mapping[str, tuple[str, Callable[[Facts], Any]]]] = {  # name: type, and how it follows from the facts
    "time": ("Double", _of("time")),
    "tool": ("String", _of("tool")),
    "work": ("String", _of("work")),
    "simulated": ("Boolean", _of("simulated")),
    "state": ("String", _of("state")),
    "edge": ("Int64", _of("edge", "number")),
    "contact_minutes": ("Double", _of("cut_minutes")),
    "wear": ("Double", _of("wear", "median")),
    "wear_low": ("Double", _of("wear", "low")),
    "wear_high": ("Double", _of("wear", "high")),
    "wear_unit": ("String", _of("wear", "unit")),
    "criterion": ("Double", _of("wear", "criterion")),
    "life_minutes": ("Double", _of("life", "median")),
    "life_minutes_low": ("Double", _of("life", "low")),
    "life_minutes_high": ("Double", _of("life", "high")),
    "probability_past": ("Double", _of("probability_past")),
    "probability_past_after_next_cut": ("Double", _of("probability_past_after_next_cut")),
    "decision": ("String", _of("decision", "kind")),
    "decision_text": ("String", _of("decision", "text")),
    "alarms": ("String", lambda facts: "\n".join(str(alarm["text"]) for alarm in facts["alarms"])),
    "source_state": ("String", _of("source", "state")),
    "facts": ("String", json_text),
}


def address_of(words: str) -> str:
    """The address of a server, checked.

    Raises
    ------
    UsageError
        It is no address of OPC UA, or not of this machine alone.

    Examples
    --------
    >>> address_of("opc.tcp://127.0.0.1:4841")
    'opc.tcp://127.0.0.1:4841'
    """
    try:
        parts = urlsplit(words)
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port, parts = None, None, urlsplit("")
    if parts.scheme != "opc.tcp" or host is None:
        raise UsageError(f"--serve {words}: give an address of OPC UA, such as opc.tcp://127.0.0.1:{PORT}.")
    if host not in LOOPBACK:
        raise UsageError(
            f"--serve {words}: {host} can be reached from other machines, and this server has no certificates of its "
            f"readers; give opc.tcp://127.0.0.1:{PORT}, and let a gateway of the shop read it there."
        )
    return words if port is not None else f"{words.rstrip('/')}:{PORT}"


class OpcUaServer:
    """The running server, an outlet of a watch.

    Parameters
    ----------
    address : str
        Of `address_of`.

    Raises
    ------
    UsageError
        asyncua is missing, or the port is taken.
    """

    def __init__(self, address: str) -> None:
        try:
            import asyncua  # noqa: F401
        except ImportError:
            raise UsageError(EXTRA) from None
        self.address = address
        self._loop = asyncio.new_event_loop()
        self._ready, self._fault = threading.Event(), ""
        self._stop: asyncio.Event | None = None
        self._nodes: dict[str, Node] = {}
        self._busy = False
        self._last: Future[None] | None = None
        logging.getLogger("asyncua").setLevel(logging.CRITICAL)
        self._thread = threading.Thread(target=self._run, name="fitmodels OPC UA server", daemon=True)
        self._thread.start()
        if not self._ready.wait(STARTED):
            self._fault = f"it did not start within {STARTED:g} s"
        if self._fault:
            raise UsageError(f"--serve {address}: the server cannot start: {self._fault}. Give another port.")

    def show(self, facts: Facts) -> None:
        """Publish the description; one that comes while the last is still being written is left out.

        Raises
        ------
        FitmodelsError
            The last one could not be published.
        """
        if not self._busy and self._thread.is_alive():
            last = self._last
            if last is not None and last.done() and (failure := last.exception()) is not None:
                raise FitmodelsError(str(failure) or type(failure).__name__)
            self._busy = True
            self._last = asyncio.run_coroutine_threadsafe(self._publish(dict(facts)), self._loop)

    def report(self, facts: Callable[[], Facts], sentences: Sequence[str], _: float | None) -> None:
        """Publish at once where something is new."""
        if sentences:
            self.show(facts())

    def close(self) -> None:
        """Stop the server."""
        if self._stop is not None and self._thread.is_alive():
            end = time.monotonic() + 2.0
            while self._busy and time.monotonic() < end:
                time.sleep(0.01)
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join(STARTED)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        with contextlib.suppress(RuntimeError):
            self._loop.run_until_complete(self._serve())
        self._loop.close()

    async def _serve(self) -> None:
        from asyncua.server.server import Server

        self._stop = asyncio.Event()
        server = Server()
        try:
            await server.init()
            server.set_endpoint(self.address)
            server.set_server_name("fitmodels watch")
            await self._add_nodes(server)
            await server.start()
        except Exception as failure:  # whatever asyncua raises: the command says it and ends
            self._fault = getattr(failure, "strerror", None) or str(failure) or type(failure).__name__
            self._ready.set()
            return
        self._ready.set()
        try:
            await self._stop.wait()
        finally:
            with contextlib.suppress(Exception):
                await server.stop()

    async def _add_nodes(self, server: "Server") -> None:
        from asyncua import ua
        from asyncua.ua.status_codes import StatusCodes

        index = await server.register_namespace(NAMESPACE)
        parent = await server.nodes.objects.add_object(
            ua.NodeId(ua.String("fitmodels"), ua.Int16(index)), f"{index}:fitmodels"
        )
        for name, (kind, _) in VALUES.items():
            variant = getattr(ua.VariantType, kind)
            empty: Any = {"String": "", "Boolean": False, "Int64": 0}.get(kind, 0.0)
            node_id = ua.NodeId(ua.String(f"fitmodels.{name}"), ua.Int16(index))
            node = await parent.add_variable(node_id, f"{index}:{name}", empty, variant)
            await node.write_value(
                ua.DataValue(StatusCode=ua.StatusCode(ua.UInt32(StatusCodes.BadWaitingForInitialData)))
            )
            self._nodes[name] = node

    async def _publish(self, facts: Facts) -> None:
        from asyncua import ua
        from asyncua.ua.status_codes import StatusCodes

        try:
            for name, (kind, of) in VALUES.items():
                value = of(facts)
                if value is None:
                    held = ua.DataValue(StatusCode=ua.StatusCode(ua.UInt32(StatusCodes.BadNoData)))
                else:
                    shown = printable(value) if kind == "String" else value
                    held = ua.DataValue(ua.Variant(shown, getattr(ua.VariantType, kind)))
                await self._nodes[name].write_value(held)
        finally:
            self._busy = False
