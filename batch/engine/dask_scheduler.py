"""Address of a Dask scheduler, tested before a client connects, and versions of the programs on a cluster."""

import asyncio
import re
import socket
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path
from typing import Any

from ...core.bounded import parse_json, read_bounded
from ...core.errors import DataError, UsageError

OfDask = Any  # half of its names have no types
FORM = re.compile(r"(?:(?P<scheme>tcp|tls)://)?(?P<host>[^\s:/\[\]]+|\[[0-9a-fA-F:.%\w]+\]):(?P<port>\d{1,5})/?")


def scheduler_address(given: str, patience: float) -> str:
    """The address of a scheduler, after a test that it is one.

    Parameters
    ----------
    given : str
        ``host:port``, with ``tcp://`` or ``tls://`` in front of it if need be, or the path of a scheduler file.
    patience : float
        In s.

    Raises
    ------
    UsageError
        Not an address, no such file, no answer, or another program that answers.
    """
    address = _in_file(Path(given)) if given.endswith(".json") else given
    parts = FORM.fullmatch(address)
    if parts is None or not 0 < int(parts["port"]) < 65536:
        raise UsageError(
            f"--dask {given}: not an address of a Dask scheduler; give 'local', tcp://HOST:PORT (the default "
            "port is 8786), or its scheduler file."
        )
    where = f"{parts['scheme'] or 'tcp'}://{parts['host']}:{parts['port']}"
    try:  # Dask itself would retry until the end of the patience
        socket.create_connection((parts["host"].strip("[]"), int(parts["port"])), patience).close()
        with ThreadPoolExecutor(1) as thread:  # a notebook has an event loop in its own thread
            kind = thread.submit(lambda: asyncio.run(_kind(where, patience))).result()
    except TimeoutError:
        raise UsageError(no_answer(given, f"nothing in {patience:g} s")) from None
    except (OSError, UnicodeError) as error:  # the second: a host name that cannot be encoded
        raise UsageError(no_answer(given, getattr(error, "strerror", None) or " ".join(str(error).split()))) from None
    if kind != "Scheduler":
        raise UsageError(no_answer(given, f"there is a {kind.lower()} instead"))
    return where


async def _kind(where: str, patience: float) -> str:
    """Kind of the program at an address: a client would wait forever for one that is no scheduler."""
    distributed: Any = import_module("distributed")
    secured = distributed.Security().get_connection_args("client")
    if where.startswith("tls") and secured["ssl_context"] is None:
        raise UsageError(
            f"{where} requires certificates: name them in Dask's configuration, distributed.comm.tls.client."
        )
    async with distributed.rpc(where, connection_args=secured) as scheduler:
        identity = await asyncio.wait_for(scheduler.identity(), patience)
    return str(identity["type"])


def no_answer(given: str, why: str) -> str:
    """Message that no scheduler answers, with what to start."""
    return (
        f"no Dask scheduler answers at {given} ({why}): start one with 'dask scheduler', workers with 'dask worker "
        "ADDRESS', and give the address that the scheduler prints, as in --dask tcp://10.0.0.3:8786."
    )


def _in_file(path: Path) -> str:
    try:
        return str(parse_json(read_bounded(path, "text", UsageError), str(path))["address"])
    except OSError as error:
        raise UsageError(
            f"{path}: the scheduler file cannot be read ({error.strerror}); 'dask scheduler --scheduler-file {path}' "
            "writes it and keeps running."
        ) from None
    except (DataError, KeyError, TypeError):
        raise UsageError(f"{path}: not a scheduler file, which contains the scheduler's address as JSON.") from None


def refuse_other_versions(client: OfDask, address: str) -> None:
    """Reject a cluster whose workers or scheduler have other versions than this process.

    Parameters
    ----------
    client : distributed.Client
    address : str

    Raises
    ------
    UsageError
        Names the first that differs and both versions.
    """
    versions = version_probe()
    ours = versions()
    theirs = {f"scheduler {address}": client.run_on_scheduler(versions)}
    theirs |= {f"worker {name}": seen for name, seen in client.run(versions).items()}
    for name, seen in theirs.items():
        if seen != ours:
            raise UsageError(
                f"the Dask {name} has {versions_text(seen)}, this process has {versions_text(ours)}: versions must be "
                f"equal, {remedy(seen, ours)}."
            )


def version_probe() -> Callable[[], dict[str, str]]:
    """The function that reports versions.

    A local function is sent by value: a function of this module would have to be imported on the other side.
    """

    def versions() -> dict[str, str]:
        import sys
        from importlib import import_module

        seen = {"Python": ".".join(map(str, sys.version_info[:2]))}
        for name in ("fitmodels", "numpy"):
            try:
                version = import_module(name).__version__
            except ImportError:
                version = ""
            seen[name] = version.split(".")[0] if name == "numpy" else version
        return seen

    return versions


def versions_text(seen: dict[str, str]) -> str:
    """Versions as a text.

    >>> versions_text({"fitmodels": "0.1.0", "Python": "3.11", "numpy": ""})
    'fitmodels 0.1.0, Python 3.11, no numpy'
    """
    names = ("fitmodels", "Python", "numpy")
    return ", ".join(f"{name} {seen[name]}" if seen[name] else f"no {name}" for name in names)


def remedy(seen: dict[str, str], ours: dict[str, str]) -> str:
    """The command that installs our versions on the other side.

    >>> old = {"fitmodels": "0.1.0", "Python": "3.11", "numpy": "2"}
    >>> remedy(old, old | {"fitmodels": "0.2.0"})
    "pip install 'fitmodels[dask]==0.2.0'"
    """
    if seen["Python"] != ours["Python"]:
        return f"in an environment of Python {ours['Python']}"
    if seen["fitmodels"] != ours["fitmodels"]:
        return f"pip install 'fitmodels[dask]=={ours['fitmodels']}'"
    return f"pip install 'numpy=={ours['numpy']}.*'"
