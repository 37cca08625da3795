"""Nodes of an OPC UA server: by id or path, and those of the companion model for machine tools.

The model (OPC 40501-1, Machine Tools - Monitoring and Job Overview) supplies the state of the channel, the rotation of
the spindle, the override of the feed, and the tool where its list has only one. Load, V, f and d are no part of it.
"""

import re
from collections.abc import AsyncIterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from ...core.errors import DataError
from ...core.suggestions import did_you_mean
from ...core.text import shortened
from ...datasets.units import canonical
from ...datasets.vocabulary import role_of
from .channels import Value
from .options import SourceOptions

if TYPE_CHECKING:
    from asyncua.client.client import Client
    from asyncua.common.node import Node

MACHINE_TOOL: Final = "http://opcfoundation.org/UA/MachineTool/"
_ID = re.compile(r"(?:nsu=(?P<uri>[^;]+);|ns=\d+;)?[isgb]=.+")
_DEPTH, _MOST = 8, 3000  # levels and nodes that are searched
_MODEL: Mapping[str, tuple[str, ...]] = {
    "state": ("ChannelState", "IsRotating"), "override": ("FeedOverride",), "tool": ("ToolId", "ControlIdentifier1"),
}  # fmt: skip
_CHANNEL_STATE = {1.0: "idle", 2.0: "idle"}  # interrupted, reset; active (0) also in rapid moves


@dataclass(slots=True)
class Nodes:
    """Nodes of the quantities of a server.

    Attributes
    ----------
    nodes : mapping of str to Node
    labels : mapping of str to str
        Id or path.
    units : mapping of str to str
        From their engineering units; empty where they have none.
    modelled : frozenset of str
        Symbols whose nodes are those of the companion model.
    notes : list of str
    """

    nodes: dict[str, "Node"] = field(default_factory=dict)
    labels: dict[str, str] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    modelled: frozenset[str] = frozenset()

    @property
    def places(self) -> dict[str, tuple[str, str]]:
        """Label and unit by symbol, as `channels_for` needs them."""
        return {symbol: (self.labels[symbol], self.units.get(symbol, "")) for symbol in self.nodes}


async def find_nodes(client: "Client", options: SourceOptions, name: str) -> Nodes:
    """Nodes of the quantities that options map, and those of the companion model where there are some.

    Raises
    ------
    DataError
        A node does not exist, is no variable, or no load is mapped.
    """
    found = Nodes()
    for symbol, words in options.map.items():
        if words.strip().casefold() != "none" and symbol != "time":
            found.nodes[symbol] = await _node(client, symbol, words.strip(), name)
            found.labels[symbol] = words.strip()
    if not any(symbol in options.loads for symbol in found.nodes):
        raise DataError(await _no_load(client, options, name))
    await _add_model(client, found, options)
    for symbol, node in found.nodes.items():
        found.units[symbol] = await _unit(node)
    return found


async def _node(client: "Client", symbol: str, words: str, name: str) -> "Node":
    """Variable that a node id, or a path of browse names below Objects, names."""
    from asyncua import ua
    from asyncua.ua.uaerrors import UaError

    if match := _ID.fullmatch(words):
        try:
            if match["uri"]:
                index = await client.get_namespace_index(match["uri"])
                words = f"ns={index};{words.partition(';')[2]}"
            node = client.get_node(words)
        except (ValueError, UaError):
            raise DataError(f"--node {symbol}={shortened(words)}: that is no node id of {name}.") from None
    else:
        node = await _by_path(client, symbol, words, name)
    try:
        kind = await node.read_node_class()
    except UaError:
        raise DataError(f"--node {symbol}={shortened(words)}: {name} has no such node.") from None
    if kind != ua.NodeClass.Variable:
        inside = ", ".join([label for label, _ in await _children(node)][:8]) or "nothing"
        raise DataError(f"--node {symbol}={shortened(words)} is no variable; it holds {inside}.")
    return node


async def _by_path(client: "Client", symbol: str, words: str, name: str) -> "Node":
    node = client.get_objects_node()
    parts = [part for part in re.split(r"(?<!\\)/", words) if part]
    for k, part in enumerate(parts):
        wanted = part.replace("\\/", "/").partition(":")[2] if re.match(r"\d+:", part) else part.replace("\\/", "/")
        children = await _children(node)
        matches = [child for label, child in children if label == wanted]
        if k == 0 and wanted == "Objects" and not matches:
            continue
        if len(matches) != 1:
            where = "/".join(parts[:k]) or "Objects"
            many = f"has {len(matches)} nodes" if matches else "has no node"
            hint = "" if matches else f" {did_you_mean(wanted, [label for label, _ in children][:20], names='It has ')}"
            raise DataError(f"--node {symbol}={shortened(words, 100)}: {where} of {name} {many} {wanted!r}.{hint}")
        node = matches[0]
    return node


async def _children(node: "Node") -> list[tuple[str, "Node"]]:
    """Name and node of what a node holds: components, properties, organized nodes."""
    from asyncua import ua
    from asyncua.common.node import Node
    from asyncua.ua.object_ids import ObjectIds

    references = await node.get_references(ObjectIds.HierarchicalReferences, ua.BrowseDirection.Forward)
    return [(reference.BrowseName.Name or "", Node(node.session, reference.NodeId)) for reference in references]


async def _no_load(client: "Client", options: SourceOptions, name: str) -> str:
    """Message on a missing load, with variables that may be one."""
    likely = [
        path async for path, label, _ in _walk(client.get_objects_node()) if role_of(label, None) in options.loads
    ][:5]
    wanted = " or ".join(f"{symbol} [{unit}]" for symbol, unit in options.loads.items())
    hint = f"; {name} has {', '.join(map(repr, likely))}" if likely else ""
    first = next(iter(options.loads), "P")
    path = likely[0] if likely else "Machine/Spindle/Power"
    return f"no node gives a load of the laws ({wanted}){hint}. Give it with --node {first}={path}."


async def _walk(node: "Node", path: str = "") -> "AsyncIterator[tuple[str, str, Node]]":
    """Path, name and node of the variables and objects below a node; the server's own are left out."""
    layer, seen = [(path, node)], 0
    for _ in range(_DEPTH):
        following = []
        for above, parent in layer:
            for label, child in await _children(parent):
                if label in ("Server", "Aliases", "Types") and not above:
                    continue
                seen += 1
                if seen > _MOST:
                    return
                here = f"{above}/{label}" if above else label
                yield here, label, child
                following.append((here, child))
        layer = following


async def _add_model(client: "Client", found: Nodes, options: SourceOptions) -> None:
    """Add state, override and tool of the companion model, where the server has it and options do not map them."""
    if MACHINE_TOOL not in await client.get_namespace_array():
        return
    there: dict[str, list[tuple[str, Node]]] = {}
    async for path, label, node in _walk(client.get_objects_node()):
        there.setdefault(label, []).append((path, node))
    added = set()
    for symbol, labels in _MODEL.items():
        nodes = next((there[label] for label in labels if label in there), [])
        if not nodes or symbol in options.map:
            continue
        nodes = _nearest(nodes, [found.labels[near] for near in ("state", *options.loads) if near in found.labels])
        if len(nodes) == 1:
            found.labels[symbol], found.nodes[symbol] = nodes[0]
            added.add(symbol)
        else:
            paths = ", ".join(path for path, _ in nodes[:4])
            found.notes.append(f"{symbol}: {len(nodes)} nodes of the machine-tool model ({paths}): choose with --node")
    found.modelled = frozenset(added)


def _nearest(nodes: "list[tuple[str, Node]]", paths: Sequence[str]) -> "list[tuple[str, Node]]":
    """Nodes that share most of their path with the first of some paths by which they are distinguished."""
    for path in paths:
        parts = path.split("/")
        shared = [_common(other.split("/"), parts) for other, _ in nodes]
        nodes = [node for node, length in zip(nodes, shared, strict=True) if length == max(shared)]
    return nodes


def _common(one: Sequence[str], two: Sequence[str]) -> int:
    """Number of first parts that two paths share."""
    same = [a == b for a, b in zip(one, two, strict=False)]
    return same.index(False) if False in same else len(same)


async def _unit(node: "Node") -> str:
    """Unit of the property EngineeringUnits; empty where there is none."""
    from asyncua.ua.uaerrors import UaError

    for label, child in await _children(node):
        if label == "EngineeringUnits":
            try:
                value = await child.read_value()
            except UaError:
                return ""
            texts = [getattr(getattr(value, part, None), "Text", None) or "" for part in ("DisplayName", "Description")]
            return next((text for text in texts if canonical(text)), texts[0])
    return ""


def value_of(symbol: str, value: object, modelled: frozenset[str]) -> Value:
    """Value of a node as a channel takes it; a state of the companion model as a word of ours.

    Examples
    --------
    >>> value_of("state", 2, frozenset({"state"})), value_of("P", 3, frozenset())
    ('idle', 3.0)
    """
    if symbol == "state" and symbol in modelled:
        if isinstance(value, bool):
            return "unknown" if value else "off"
        return _CHANNEL_STATE.get(float(value), "unknown") if isinstance(value, (int, float)) else "unknown"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (int, float)):
        return float(value)
    return value if isinstance(value, str) else None
