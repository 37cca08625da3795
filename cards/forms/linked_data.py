"""The card as linked data: a schema.org Dataset of the measurements, and a CreativeWork of the model made from it."""

import re
from collections.abc import Iterator
from typing import Any

from ...core.text import json_text
from ..content.card import Card
from ..content.parts import FactorRangePart
from .citation import author

CONTEXT = "https://schema.org"  # a name, never fetched
SPDX = re.compile(r"[A-Za-z0-9][A-Za-z0-9.+-]*")
RAW_IN_A_SCRIPT = "<>&\u2028\u2029"  # could end the element, or a line of an old reader


def json_ld(card: Card) -> str:
    """JSON-LD that is safe in a script element.

    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.card import compose
    >>> "<" in json_ld(compose(parameters.collect(tool="</script>", work="709M40")))
    False
    """
    said = [*_dataset(card), _model(card)]
    text = json_text({"@context": CONTEXT, "@graph": said}, indent=1)
    for letter in RAW_IN_A_SCRIPT:
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return text + "\n"


def _dataset(card: Card) -> Iterator[dict[str, Any]]:
    """The measurements, if the card has a data file."""
    p = card.provenance
    if not (p.data_file or p.data_sha256):
        return
    kind = {True: "Simulated tests", False: "Measurements", None: "Tests"}[card.identity.simulated]
    rows = f"{p.rows} rows" if p.rows is not None else "rows"
    of = f"{card.identity.tool} on {card.identity.work}"
    note = f" {card.identity.note}" if card.identity.note else ""
    yield _stated({
        "@type": "Dataset",
        "@id": _id("data", p.data_sha256),
        "name": f"{kind} of {of}",
        "alternateName": p.data_file,
        "description": f"{kind} of {of}: {rows} of {p.data_file or 'a data file'}, behind a model card.{note}",
        "identifier": _checksum(p.data_sha256),
        "variableMeasured": list(_variables(card)),
        "measurementTechnique": _technique(card),
        "isAccessibleForFree": bool(card.publication.license),
        "license": _license(card.publication.license),
        "creator": _creators(card),
    })  # fmt: skip


def _model(card: Card) -> dict[str, Any]:
    p, i = card.publication, card.identity
    data = _id("data", card.provenance.data_sha256)
    behind = card.provenance.data_file or card.provenance.data_sha256
    return _stated({
        "@type": "CreativeWork",
        "@id": _id("parameters", i.content_sha256),
        "additionalType": "model card of a tool/work pair",
        "name": card.title,
        "description": card.summary,
        "identifier": [each for each in (_checksum(i.content_sha256), _doi(p.doi)) if each],
        "version": i.content_sha256[:12],
        "schemaVersion": card.schema_,
        "isBasedOn": ({"@id": data} if data else card.provenance.data_file) if behind else "",
        "license": _license(p.license),
        "creator": _creators(card),
        "dateCreated": card.provenance.created,
        "keywords": list(p.keywords),
        "inLanguage": "en",
        "usageInfo": " ".join([*([f"Verdict: {card.verdict}."] if card.verdict else []), *card.out_of_scope]),
        "conditionsOfAccess": " ".join(card.safety),
    })  # fmt: skip


def _stated(said: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in said.items() if value not in ("", None, [], {})}


def _id(kind: str, sha256: str) -> str:
    return f"urn:fitmodels:{kind}:sha256:{sha256}" if sha256 else ""


def _checksum(sha256: str) -> dict[str, str] | None:
    return {"@type": "PropertyValue", "propertyID": "SHA-256", "value": sha256} if sha256 else None


def _doi(doi: str) -> dict[str, str] | None:
    return {"@type": "PropertyValue", "propertyID": "DOI", "value": doi} if doi else None


def _license(spdx: str) -> str:
    return f"https://spdx.org/licenses/{spdx}.html" if SPDX.fullmatch(spdx) and "LicenseRef" not in spdx else spdx


def _creators(card: Card) -> list[dict[str, str]]:
    return [_creator(written) for written in card.publication.authors]


def _creator(written: str) -> dict[str, str]:
    a = author(written)
    more = {"familyName": a.family, "givenName": a.given}
    orcid = f"https://orcid.org/{a.orcid}" if a.orcid else ""
    return _stated({"@type": "Person" if a.family else "Organization", "name": a.name, **more, "sameAs": orcid})


def _factors_of(card: Card) -> dict[str, FactorRangePart]:
    """Factors of the laws, and of the design where it is known, by symbol."""
    factors: dict[str, FactorRangePart] = {f.symbol: f for law in card.laws for f in law.domain}
    factors.update({f.symbol: f for f in card.design.factors} if card.design else {})
    return factors


def _variables(card: Card) -> Iterator[dict[str, Any]]:
    """Factors with their ranges, then what was measured over them."""
    factors = _factors_of(card)
    for f in factors.values():
        ends = {"minValue": f.low.value, "maxValue": f.high.value}
        yield {**_variable(f.symbol, f.quantity, f.unit), **ends}
    for law in card.laws:
        if law.response not in factors:
            yield _variable(law.response, law.quantity, law.unit)
    if card.dynamics is not None:
        yield _variable(card.dynamics.title, "dynamics", "")


def _variable(symbol: str, quantity: str, unit: str) -> dict[str, Any]:
    return _stated({"@type": "PropertyValue", "name": quantity, "alternateName": symbol, "unitText": unit})


def _technique(card: Card) -> list[str]:
    i = card.identity
    sensors = [" ".join(part for part in (s.symbol, s.unit, s.model, s.words) if part) for s in i.sensors]
    kind = "simulation" if i.simulated else "cutting tests" if card.laws else "recorded run of a machine"
    return [part for part in (kind, i.machine, i.setup, *sensors) if part]
