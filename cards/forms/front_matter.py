"""The YAML front matter of README.md: metadata as the Hugging Face hub reads them, and our own."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ..content.card import Card
from ..content.parts import FactPart

UNSAFE = re.compile(r"[^\w.-]+", re.ASCII)
LONGEST = 96  # characters of a name on the hub
# SPDX identifiers that the hub knows, in its small letters; of others it wants license: other and a name
HUB_LICENSES = frozenset((
    "afl-3.0", "agpl-3.0", "apache-2.0", "artistic-2.0", "bsd", "bsd-2-clause", "bsd-3-clause", "bsd-3-clause-clear",
    "bsl-1.0", "cc", "cc-by-2.0", "cc-by-3.0", "cc-by-4.0", "cc-by-nc-2.0", "cc-by-nc-3.0", "cc-by-nc-4.0",
    "cc-by-nc-nd-3.0", "cc-by-nc-nd-4.0", "cc-by-nc-sa-2.0", "cc-by-nc-sa-3.0", "cc-by-nc-sa-4.0", "cc-by-nd-4.0",
    "cc-by-sa-3.0", "cc-by-sa-4.0", "cc0-1.0", "cdla-permissive-1.0", "cdla-permissive-2.0", "cdla-sharing-1.0",
    "ecl-2.0", "epl-1.0", "epl-2.0", "eupl-1.1", "eupl-1.2", "gfdl", "gpl-2.0", "gpl-3.0", "isc", "lgpl-2.1",
    "lgpl-3.0", "mit", "mpl-2.0", "mulanpsl-2.0", "ncsa", "odbl", "odc-by", "ofl-1.1", "pddl", "postgresql",
    "unlicense", "wtfpl", "zlib",
))  # fmt: skip
RESULTS = {"R²": ("r_squared", "R²"), "residual SE": ("residual_standard_error", "residual standard error")}
HELD_OUT = "held-out fit"
KINDS: Mapping[bool | None, tuple[str, ...]] = {True: ("simulated",), False: ("measured",), None: ()}  # of the data
READ_OTHERWISE = "<>&[]`{}"


def hub_metadata(card: Card) -> dict[str, Any]:
    """Front matter: licence, tags, results, then tool and work.

    ``huggingface_hub.ModelCard.load`` reads it, and gives its ``model-index`` back as it was.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.card import compose
    >>> hub_metadata(compose(parameters.collect(tool="GC435", work="709M40")))["tags"]
    ['machining', 'measured']
    """
    results = list(_results(card))
    head: dict[str, Any] = {
        **_license(card.publication.license),
        "language": "en",
        "library_name": "fitmodels",
        "tags": _tags(card),
        "datasets": [_hub_name(card.provenance.data_file)] if card.provenance.data_file else [],
        "metrics": list(dict.fromkeys(metric["type"] for result in results for metric in result["metrics"])),
    }
    if results:
        head["model-index"] = [{"name": card.title, "results": results}]
    return {**head, **_own(card)}


def _license(spdx: str) -> dict[str, str]:
    if not spdx:
        return {"license": "unknown"}
    known = spdx.lower().removesuffix("-only").removesuffix("-or-later")
    return {"license": known} if known in HUB_LICENSES else {"license": "other", "license_name": spdx}


def _tags(card: Card) -> list[str]:
    said = ["machining", *KINDS[card.identity.simulated]]
    said += [law.quantity.replace(" ", "-") for law in card.laws]
    said += [f"{form.replace(' ', '-')}-law" for form in (law.form for law in card.laws)]
    said += ["system-identification"] if card.dynamics else []
    said += ["pi-control"] if card.gains else []
    said += [f"iso-513-{card.identity.iso513}"] if card.identity.iso513 else []
    return list(dict.fromkeys([*said, *card.publication.keywords]))


def _results(card: Card) -> Iterator[dict[str, Any]]:
    """A result for each law, and one for the dynamics; ``config`` keeps them apart on the hub."""
    for law in card.laws:
        metrics = [_metric(*RESULTS[item.name], item, law.response) for item in law.statistics if item.name in RESULTS]
        if metrics:
            yield _result("tabular-regression", f"{law.response}: {law.quantity}", law.response, metrics, card)
    if card.dynamics is not None:
        named = [item for item in card.dynamics.facts if item.name == HELD_OUT and item.number.text]
        metrics = [_metric("held_out_fit", HELD_OUT, item, card.dynamics.title) for item in named]
        if metrics:
            yield _result("time-series-forecasting", card.dynamics.title, card.dynamics.title, metrics, card)


def _result(task: str, name: str, config: str, metrics: list[dict[str, Any]], card: Card) -> dict[str, Any]:
    data = card.provenance.data_file or "not given"
    return {
        "task": {"type": task, "name": name},
        "dataset": {"type": _hub_name(data), "name": data, "config": config},
        "metrics": metrics,
    }


def _metric(kind: str, name: str, item: FactPart, of: str) -> dict[str, Any]:
    unit = f", {item.number.unit}" if item.number.unit else ""
    return {"type": kind, "value": float(item.number.text), "name": f"{name} of {of}{unit}"}


def _own(card: Card) -> dict[str, Any]:
    i, p = card.identity, card.provenance
    return {
        "schema": card.schema_,
        "tool": i.tool,
        "work": i.work,
        "simulated": i.simulated,
        **({"verdict": card.verdict} if card.verdict else {}),
        "sha256": i.content_sha256,
        "data_file": p.data_file,
        "data_sha256": p.data_sha256,
        "fitmodels": i.fitmodels,
    }


def _hub_name(name: str) -> str:
    """A name in the letters that the hub takes."""
    return UNSAFE.sub("-", name).strip("-.")[:LONGEST].strip("-.") or "unnamed"


def yaml_text(data: Mapping[str, Any]) -> str:
    r"""A mapping as YAML in blocks: numbers, truth, texts, and lists and mappings of them.

    >>> print(yaml_text({"tool": "<b>", "simulated": True, "metrics": [{"value": 1e-05}]}), end="")
    tool: "\u003cb\u003e"
    simulated: true
    metrics:
      - value: 1.0e-05
    """
    return "".join(f"{line}\n" for line in _lines(data))


def _lines_of_mapping(value: Mapping[str, Any]) -> Iterator[str]:
    for key, item in value.items():
        if isinstance(item, Mapping | list | tuple) and item:
            yield f"{key}:"
            yield from (f"  {line}" for line in _lines(item))
        else:
            yield f"{key}: {_scalar(item)}"


def _lines(value: Mapping[str, Any] | Sequence[Any]) -> Iterator[str]:
    if isinstance(value, Mapping):
        yield from _lines_of_mapping(value)
        return
    for item in value:
        first, *rest = _lines(item) if isinstance(item, Mapping) else [_scalar(item)]
        yield f"- {first}"
        yield from (f"  {line}" for line in rest)


def _scalar(value: object) -> str:
    if isinstance(value, str):
        return f'"{"".join(map(_letter, value))}"'
    if isinstance(value, float):
        return _number(value)
    return json.dumps(value)


def _letter(letter: str) -> str:
    if letter in READ_OTHERWISE or not letter.isprintable():
        code = ord(letter)
        return f"\\U{code:08x}" if code > 0xFFFF else f"\\u{code:04x}"
    return f"\\{letter}" if letter in '\\"' else letter


def _number(value: float) -> str:
    """YAML 1.1 takes 1e-05 for a text: it wants a point in a number with a power."""
    mantissa, e, power = repr(value).partition("e")
    return f"{mantissa}.0e{power}" if e and "." not in mantissa else repr(value)
