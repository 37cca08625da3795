"""Where a Dask scheduler is, looked at before a client does, which waits for ever for some that are none."""

import asyncio
import json
import re
import socket
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path
from typing import Any

from ...core.errors import UsageError

FORM = re.compile(r"(?:(?P<scheme>tcp|tls)://)?(?P<host>[^\s:/\[\]]+|\[[0-9a-fA-F:.%\w]+\]):(?P<port>\d{1,5})/?")


def scheduler_address(given: str, patience: float) -> str:
    """Give the address of a scheduler, after it has said that it is one.

    Parameters
    ----------
    given : str
        ``host:port``, with ``tcp://`` or ``tls://`` in front of it if need be, or the path of a scheduler file.
    patience : float
        In s.

    Raises
    ------
    UsageError
        No address, no such file, nothing that answers, or something else that does.
    """
    address = _in_file(Path(given)) if given.endswith(".json") else given
    parts = FORM.fullmatch(address)
    if parts is None or not 0 < int(parts["port"]) < 65536:
        raise UsageError(
            f"--dask {given}: no address of a Dask scheduler; give 'local', tcp://HOST:PORT as it tells it itself "
            "(its port is 8786 unless it says so), or its scheduler file."
        )
    where = f"{parts['scheme'] or 'tcp'}://{parts['host']}:{parts['port']}"
    try:  # Dask itself tries again and again, here, and a port without anybody would take all of the time
        socket.create_connection((parts["host"].strip("[]"), int(parts["port"])), patience).close()
        with ThreadPoolExecutor(1) as thread:  # a notebook runs an event loop in its own
            kind = thread.submit(lambda: asyncio.run(_kind(where, patience))).result()
    except TimeoutError:
        raise UsageError(silent(given, f"nothing in {patience:g} s")) from None
    except (OSError, UnicodeError) as error:  # the second: a name that no name server can be asked for
        raise UsageError(silent(given, getattr(error, "strerror", None) or " ".join(str(error).split()))) from None
    if kind != "Scheduler":
        raise UsageError(silent(given, f"what answers is a {kind.lower()}"))
    return where


async def _kind(where: str, patience: float) -> str:
    """What it is that answers: a client would wait for ever for somebody who accepts a connection and is silent."""
    distributed: Any = import_module("distributed")
    secured = distributed.Security().get_connection_args("client")
    if where.startswith("tls") and secured["ssl_context"] is None:
        raise UsageError(f"{where} wants certificates: name them in Dask's configuration, distributed.comm.tls.client.")
    async with distributed.rpc(where, connection_args=secured) as scheduler:
        told = await asyncio.wait_for(scheduler.identity(), patience)
    return str(told["type"])


def silent(given: str, why: str) -> str:
    """Say that no scheduler answers, and what to start."""
    return (
        f"no Dask scheduler answers at {given} ({why}): start one with 'dask scheduler', workers with 'dask worker "
        "ADDRESS', and give the address that the scheduler tells, as in --dask tcp://10.0.0.3:8786."
    )


def _in_file(path: Path) -> str:
    try:
        return str(json.loads(path.read_text("utf-8"))["address"])
    except OSError as error:
        raise UsageError(
            f"{path}: the scheduler file cannot be read ({error.strerror}); 'dask scheduler --scheduler-file {path}' "
            "writes it and keeps running."
        ) from None
    except (ValueError, KeyError, TypeError):
        raise UsageError(f"{path}: no scheduler file, which holds the scheduler's address as JSON.") from None
