"""What card.toml tells of a card beyond its parameter file, laid over the identity of that file."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ...core.errors import DataError
from ...parameters import ParameterFile, Sensor
from ...parameters.errors import short, short_name
from ..content.identity import checksum
from ..content.parts import Publication

SENSOR_KEYS = ("symbol", "unit", "model", "sample_rate", "sd")
NO_SENSORS = "none"  # symbol of the entry that holds why there was no sensor


@dataclass(frozen=True, slots=True)
class PublicationMetadata:
    """What card.toml tells.

    Attributes
    ----------
    publication : Publication
        Licence, authors, contact, DOI, title, keywords.
    machine, iso513, setup : str
        Empty where it does not say.
    sensors : tuple of Sensor
        One with the symbol ``none`` holds why there was none.
    tool_properties : dict
        By the symbols of ISO 13399.
    name : str
        The file, for sentences.
    """

    publication: Publication = field(default_factory=Publication)
    machine: str = ""
    iso513: str = ""
    setup: str = ""
    sensors: tuple[Sensor, ...] = ()
    tool_properties: Mapping[str, float | str] = field(default_factory=dict)
    name: str = "card.toml"

    def applied(self, pf: ParameterFile) -> ParameterFile:
        """The file with this identity, for a card: its checksum stays that of the file on disk, so it is not written.

        The note says what comes from card.toml.

        Raises
        ------
        DataError
            Both tell something, and not the same.
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
        """Whether the file tells it already; that it tells something else is refused."""
        if there in (None, ""):
            return False
        if there != here:
            raise DataError(
                f"{self.name}: {short_name(name)} is {short(here)}, but the parameter file says {short(there)}; leave "
                "it out here, or fit again with what is right."
            )
        return True

    def _sensors(self, there: tuple[Sensor, ...]) -> Iterator[Sensor]:
        """Sensors of the file, with what it leaves open filled in, then further ones."""
        if there and any(s.symbol == NO_SENSORS for s in self.sensors):
            raise DataError(f"{self.name}: no_sensors is told, but the parameter file has {len(there)}; leave it out.")
        here = {s.symbol: s for s in self.sensors}
        for old in there:
            new = here.pop(old.symbol, old)
            more = {name: value for name in SENSOR_KEYS if (value := getattr(new, name)) is not None
                    and not self._same(f"{name} of sensor {old.symbol}", getattr(old, name), value)}  # fmt: skip
            yield old.model_copy(update=more) if more else old
        yield from here.values()


def _words(key: str) -> str:
    return {"iso513": "ISO 513 group", "iso13399": "properties of the tool", "setup": "set-up"}.get(key, key)
