"""An OPC UA server of a machine for tests, as a process of its own: ``python opcua_machine.py PORT [model] [FOLDER]``.

With a folder it only takes connections that are signed and encrypted; it reads its certificate and key there.

It writes a load that rises by .001 kW every 20 ms. Commands are lines on standard input: ``bad NAME``,
``uncertain NAME``, ``good NAME``, ``clock SECONDS``, ``hold``, ``go``, ``set NAME VALUE``, and
``play FILE BEGUN`` in place of the rising load: rows ``seconds,W,state`` of a run that begun at that time, s
since 1970, with the times of that run; what is past is left out. It prints ``ready``, and ``done`` after each command.
"""

import asyncio
import logging
import sys
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

from asyncua import Server, ua

STEP = 0.001  # kW from one value to the next
PERIOD = 0.02  # s
STATUS = {"bad": ua.StatusCodes.BadSensorFailure, "uncertain": ua.StatusCodes.UncertainSensorNotAccurate}


async def main(port, model, folder):
    logging.disable(logging.CRITICAL)
    server = Server()
    await server.init()
    server.set_endpoint(f"opc.tcp://127.0.0.1:{port}")
    if folder:
        await server.set_application_uri("urn:fitmodels:test:server")
        await server.load_certificate(f"{folder}/server.pem")
        await server.load_private_key(f"{folder}/server-key.pem")
    kind = ua.SecurityPolicyType
    server.set_security_policy([kind.Basic256Sha256_SignAndEncrypt if folder else kind.NoSecurity])
    index = await server.register_namespace("urn:fitmodels:test")
    machine = await server.nodes.objects.add_object(index, "Machine")
    spindle = await machine.add_object(index, "Spindle")
    values = {
        "power": await spindle.add_variable(ua.NodeId("power", index), "Power", 1000.0),
        "force": await spindle.add_variable(ua.NodeId("force", index), "Force", 500.0),
        "speed": await spindle.add_variable(ua.NodeId("speed", index), "Speed", 120.0),
        "word": await machine.add_variable(ua.NodeId("state", index), "State", "idle"),
        "feed": await spindle.add_variable(ua.NodeId("feed", index), "Feed", 0.2),
    }
    unit = ua.EUInformation(DisplayName=ua.LocalizedText("W"))
    await values["power"].add_property(index, "EngineeringUnits", unit)
    if model:
        tools = await server.register_namespace("http://opcfoundation.org/UA/MachineTool/")
        monitoring = await machine.add_object(tools, "Monitoring")
        channel = await monitoring.add_object(tools, "Channel1")
        values["state"] = await channel.add_variable(tools, "ChannelState", ua.Int32(0))
        values["override"] = await channel.add_variable(tools, "FeedOverride", 100.0)
        await values["override"].add_property(
            0, "EngineeringUnits", ua.EUInformation(DisplayName=ua.LocalizedText("%"))
        )
        tool = await (await machine.add_object(tools, "Tools")).add_object(tools, "Tool1")
        values["tool"] = await tool.add_variable(tools, "ControlIdentifier1", ua.UInt32(7))
    if "wait" in sys.argv:  # until the one before it is gone
        sys.stdout.write("waits\n")
        sys.stdout.flush()
        sys.stdin.readline()
    async with server:
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        await run(server, values)


async def run(server, values):
    loop, lines = asyncio.get_running_loop(), asyncio.Queue()
    loop.add_reader(sys.stdin.fileno(), lambda: lines.put_nowait(sys.stdin.readline()))
    shift, held, bad, k, due, rows = 0.0, False, {}, 0, loop.time(), None
    numbers = {"power": 1000.0, "force": 500.0}

    async def write(name, value, status=0, at=None):
        stamp = (datetime.now(UTC) if at is None else datetime.fromtimestamp(at, UTC)) + timedelta(seconds=shift)
        variant = None if status == STATUS["bad"] else ua.Variant(value, ua.VariantType.Double)
        given = ua.DataValue(variant, ua.StatusCode(ua.UInt32(status)), SourceTimestamp=stamp, ServerTimestamp=stamp)
        await server.write_attribute_value(values[name].nodeid, given)

    while True:
        while not lines.empty():
            words = lines.get_nowait().split()
            if not words:
                return
            command, *rest = words
            if command in ("bad", "uncertain"):
                bad[rest[0]] = (
                    ua.StatusCodes.BadSensorFailure if command == "bad" else ua.StatusCodes.UncertainSensorNotAccurate
                )
                await write(rest[0], 0.0, bad[rest[0]])
            elif command == "good":
                bad.pop(rest[0])
            elif command == "clock":
                shift += float(rest[0])
            elif command == "set":
                kind = (await values[rest[0]].read_data_value()).Value.VariantType
                value = float(rest[1]) if kind == ua.VariantType.Double else int(rest[1])
                await values[rest[0]].write_value(ua.Variant(value, kind))
            elif command == "play":
                begun = float(rest[1])
                rows = [line.split(",") for line in Path(rest[0]).read_text().splitlines()]
                rows = [row for row in rows if float(row[0]) > (time.time() - begun)]
            else:
                held = command == "hold"
            sys.stdout.write("done\n")
            sys.stdout.flush()
        if rows is not None:
            while rows and float(rows[0][0]) <= (time.time() - begun):
                seconds, watts, word = rows.pop(0)
                if "power" not in bad:
                    await write("power", float(watts), at=begun + float(seconds))
                await values["word"].write_value(word)
        elif not held:
            k += 1
            for name, start in numbers.items():
                if name not in bad:
                    await write(name, start + 1000 * STEP * k)
        due += PERIOD
        await asyncio.sleep(max(0.0, due - loop.time()))


if __name__ == "__main__":
    asyncio.run(main(int(sys.argv[1]), "model" in sys.argv, next((word for word in sys.argv[2:] if "/" in word), "")))
