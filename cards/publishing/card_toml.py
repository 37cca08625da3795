"""card.toml: metadata of a publication read, validated and merged into the identity of a parameter file."""

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ...core.bounded import parse_toml, read_bounded
from ...core.errors import DataError
from ...core.files import cause
from ...core.suggestions import closest
from ...core.text import shortened
from ...parameters import ParameterFile
from ...parameters.messages import schema_message, short
from ...parameters.sections.origin import IdentitySection, Sensor
from ..content.identity import checksum
from ..content.parts import PublicationPart

SENSOR_KEYS = ("symbol", "unit", "model", "sample_rate", "sd")
NO_SENSORS = "none"  # symbol of the entry that holds why there was no sensor
LONGEST = 5000  # characters of a text
TEXTS = ("license", "contact", "doi", "title", "machine", "iso513", "setup", "no_sensors")
LISTS = ("authors", "keywords")
KEYS = (*TEXTS, *LISTS, "sensors", "tool_properties")
SPDX = re.compile(r"[A-Za-z0-9][A-Za-z0-9.+-]*(?: (?:AND|OR|WITH) [A-Za-z0-9][A-Za-z0-9.+-]*)*")
SCHEMES = ("https", "http", "mailto", "orcid", "doi")  # of addresses
LABELS = ("email", "e-mail", "mail", "tel", "tel.", "phone", "fax", "fax.", "web")  # as in Tel.:+49 711 1234
SCHEME = re.compile(r"(?<![\w.+-])(?:([A-Za-z][A-Za-z0-9.+-]{0,60}):(?=\S)|((?:java|vb)script)\s*:)", re.I)
DOI = re.compile(r"(?:https?://(?:dx\.)?doi\.org/|doi:)?\s*(10\.\d{4,9}/\S+)")


@dataclass(frozen=True, slots=True)
class PublicationMetadata:
    """Metadata of card.toml.

    Attributes
    ----------
    publication : Publication
        Licence, authors, contact, DOI, title, keywords.
    machine, iso513, setup : str
        Empty if not given.
    sensors : tuple of Sensor
        One with the symbol ``none`` holds the reason for having none.
    tool_properties : dict
        By the symbols of ISO 13399.
    name : str
        The file, for messages.
    """

    publication: PublicationPart = field(default_factory=PublicationPart)
    machine: str = ""
    iso513: str = ""
    setup: str = ""
    sensors: tuple[Sensor, ...] = ()
    tool_properties: Mapping[str, float | str] = field(default_factory=dict)
    name: str = "card.toml"

    def applied(self, pf: ParameterFile) -> ParameterFile:
        """The file with this identity, for a card; its checksum remains that of the file on disk, so do not write it.

        The note names the facts from card.toml.

        Raises
        ------
        DataError
            The two contradict each other.
        """
        given = {"machine": self.machine, "iso513": self.iso513, "setup": self.setup}
        new: dict[str, Any] = {k: v for k, v in given.items() if v and not self._same(k, getattr(pf.identity, k), v)}
        sensors = tuple(self._sensors(pf.identity.sensors))
        properties = {k: v for k, v in self.tool_properties.items()
                      if not self._same(f"tool_properties.{k}", pf.identity.iso13399.get(k), v)}  # fmt: skip
        new |= {"sensors": sensors} if sensors != pf.identity.sensors else {}
        new |= {"iso13399": {**pf.identity.iso13399, **properties}} if properties else {}
        if not new:
            return pf
        note = f"From {Path(self.name).name}, not from the parameter file: {', '.join(map(_words, new))}."
        new["note"] = f"{pf.identity.note.rstrip('.')}. {note}" if pf.identity.note else note
        identity = pf.identity.model_copy(update=new)
        return pf.model_copy(update={"identity": identity, "content_sha256": checksum(pf)})

    def _same(self, name: str, there: object, here: object) -> bool:
        """Whether the parameter file has this value already; another value is an error."""
        if there in (None, ""):
            return False
        if there != here:
            raise DataError(
                f"{self.name}: {shortened(name)} is {short(here)}, but the parameter file has {short(there)}; remove "
                "it here, or fit again with the correct value."
            )
        return True

    def _sensors(self, there: tuple[Sensor, ...]) -> Iterator[Sensor]:
        """Sensors of the file completed by those of card.toml, then further ones."""
        if there and any(s.symbol == NO_SENSORS for s in self.sensors):
            raise DataError(
                f"{self.name}: no_sensors is given, but the parameter file has {len(there)} sensors; remove it."
            )
        here = {s.symbol: s for s in self.sensors}
        for old in there:
            new = here.pop(old.symbol, old)
            more = {name: value for name in SENSOR_KEYS if (value := getattr(new, name)) is not None
                    and not self._same(f"{name} of sensor {old.symbol}", getattr(old, name), value)}  # fmt: skip
            yield old.model_copy(update=more) if more else old
        yield from here.values()


def _words(key: str) -> str:
    return {"iso513": "ISO 513 group", "iso13399": "properties of the tool", "setup": "set-up"}.get(key, key)


def read_toml(path: str | os.PathLike[str], above: str | os.PathLike[str] | None = None) -> PublicationMetadata:
    """Read a card.toml.

    Parameters
    ----------
    path : path
    above : path, optional
        Another one, for fields that this one lacks.

    Raises
    ------
    DataError
        It is not TOML, has an unknown key, or a value of the wrong type; the message names it.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "card.toml"
    ...     _ = path.write_text('license = "CC-BY-4.0"')
    ...     read_toml(path).publication.license
    'CC-BY-4.0'
    """
    name = str(path)
    data = _parsed(Path(path), name)
    _known(data, KEYS, name)
    if above is not None:
        read_toml(above)  # its own faults under its own name
        data = _laid_over(_parsed(Path(above), str(above)), data)
    texts = {key: _text(data, key, name) for key in TEXTS}
    return PublicationMetadata(
        publication=PublicationPart(
            license=_matched(texts["license"], SPDX, "license", "an SPDX identifier such as CC-BY-4.0", name),
            authors=tuple(_addressed(each, "authors", name) for each in _texts(data, "authors", name)),
            contact=_addressed(texts["contact"], "contact", name),
            doi=_matched(texts["doi"], DOI, "doi", "a DOI such as 10.5281/zenodo.1234567", name),
            title=texts["title"],
            keywords=_texts(data, "keywords", name),
        ),
        machine=texts["machine"],
        iso513=texts["iso513"],
        setup=texts["setup"],
        name=name,
        **_of_identity(data, texts, name),
    )


def _parsed(path: Path, name: str) -> dict[str, Any]:
    try:
        content = read_bounded(path, "card")
    except OSError as error:
        raise DataError(
            f"{name}: cannot be read: {cause(error)}; fitmodels publish FOLDER --check writes a template."
        ) from None
    return parse_toml(content, name, remedy="Save it as UTF-8; write texts in double quotes, lists in brackets.")


def _laid_over(above: Mapping[str, Any], data: Mapping[str, Any]) -> dict[str, Any]:
    """Both files merged, ``data`` first; sensors and the reason for having none are one field.

    Empty fields, as in a template, have no precedence.
    """
    given = {key: value for key, value in data.items() if value not in ("", [])}
    about_sensors = {"sensors", "no_sensors"}
    hidden = about_sensors if about_sensors & set(given) else set()
    return {**{key: value for key, value in above.items() if key not in hidden}, **given}


def _known(data: Mapping[str, Any], keys: Iterable[str], name: str, where: str = "") -> None:
    for key in data:
        if key not in keys:
            near = closest(key, keys)
            hint = f"did you mean {near}?" if near else f"the keys are {', '.join(keys)}."
            raise DataError(f"{name}: {short(key)} is no key{where}; {hint}")


def _text(data: Mapping[str, Any], key: str, name: str) -> str:
    value = data.get(key, "")
    if not isinstance(value, str):
        raise DataError(f"{name}: {key} should be text in double quotes, not {short(value)}.")
    return _short_enough(value, key, name)


def _texts(data: Mapping[str, Any], key: str, name: str) -> tuple[str, ...]:
    value = data.get(key, [])
    if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
        seen = short(value) if not isinstance(value, list) else short(next(x for x in value if not isinstance(x, str)))
        raise DataError(f'{name}: {key} should be a list of texts, {key} = ["..."], not {seen}.')
    return tuple(said for item in value if (said := _short_enough(item, key, name)))


def _short_enough(value: str, key: str, name: str) -> str:
    """A text on one line; DataError where it is too long for a page."""
    text = " ".join(value.split())
    if len(text) > LONGEST:
        raise DataError(f"{name}: {key} has {len(text)} characters; the limit is {LONGEST}. Shorten it.")
    return text


def _matched(value: str, form: re.Pattern[str], key: str, what: str, name: str) -> str:
    found = form.fullmatch(value)
    if value and found is None:
        raise DataError(f"{name}: {key} {short(value)} is not {what}.")
    return "" if found is None else found[found.lastindex or 0]


def _addressed(value: str, key: str, name: str) -> str:
    """A text whose addresses, if any, are of the web or of mail; DataError for another scheme, such as javascript."""
    for found in SCHEME.finditer(value):
        scheme = found[1] or found[2]
        if scheme.lower() not in (*SCHEMES, *LABELS):
            raise DataError(
                f"{name}: {key} {short(value)} has an address that begins with {short(scheme + ':')}; give an e-mail "
                f"address, or one that begins with {', '.join(SCHEMES)}."
            )
    return value


def _of_identity(data: Mapping[str, Any], texts: Mapping[str, str], name: str) -> dict[str, Any]:
    """Sensors and properties by the parameter file's own rules."""
    sensors = data.get("sensors", [])
    if not isinstance(sensors, list) or not all(isinstance(item, dict) for item in sensors):
        raise DataError(f"{name}: sensors should be blocks that begin with [[sensors]].")
    for number, item in enumerate(sensors, 1):
        _known(item, SENSOR_KEYS, name, f" of sensor {number}")
    if sensors and texts["no_sensors"]:
        raise DataError(f"{name}: no_sensors is given with {len(sensors)} sensors; remove one of them.")
    if texts["no_sensors"]:
        sensors = [{"symbol": NO_SENSORS, "unit": "", "model": texts["no_sensors"]}]
    properties = data.get("tool_properties", {})
    given = {"iso513": texts["iso513"] or None, "iso13399": properties, "sensors": _floats(sensors)}
    try:
        made = IdentitySection.model_validate({"tool": "x", "work": "x", "simulated": False, **given})
    except ValidationError as error:
        words = schema_message(error, given)
        raise DataError(f"{name}: {words.replace('iso13399', 'tool_properties')}.") from None
    return {"sensors": made.sensors, "tool_properties": dict(made.iso13399)}


def _floats(sensors: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{k: float(v) if type(v) is int else v for k, v in item.items()} for item in sensors]
