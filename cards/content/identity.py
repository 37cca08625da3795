"""Identity and provenance of a card, and its slug."""

import hashlib
import re
import shlex
import unicodedata

from ...parameters import ParameterFile
from ...parameters.file_format import content_sha256
from .numbers import figure, quantity
from .parts import FactPart, IdentityPart, NumberPart, ProvenancePart, SensorPart

ABSOLUTE = re.compile(r"[/~]|\.{1,2}/|[A-Za-z]:/")  # path with forward slashes
LONGEST = 40  # characters of tool and of work in a slug


def identity_part(pf: ParameterFile) -> IdentityPart:
    """Identity with checksum and versions; empty where the file gives none."""
    i = pf.identity
    return IdentityPart(
        tool=i.tool,
        work=i.work,
        machine=i.machine or "",
        iso513=i.iso513 or "",
        setup=i.setup or "",
        tool_properties=tuple(_property(name, value) for name, value in i.iso13399.items()),
        sensors=tuple(
            SensorPart(symbol=s.symbol, unit=s.unit, model=s.model or "", words=_sensor(s.sample_rate, s.sd, s.unit))
            for s in i.sensors
        ),
        simulated=i.simulated,
        note=i.note or "",
        content_sha256=checksum(pf),
        parameters_schema=pf.schema_version,
        fitmodels=pf.provenance.fitmodels,
    )


def provenance_part(pf: ParameterFile) -> ProvenancePart:
    """Data, command, seed and versions that reproduce the file."""
    p = pf.provenance
    return ProvenancePart(
        data_file=p.data_file or "",
        data_sha256=p.data_sha256 or "",
        rows=p.n_rows,
        command=" && ".join((*([p.command] if p.command else []), *p.then)),
        created=p.created or "",
        seed=p.seed,
        versions={"fitmodels": p.fitmodels, **dict(sorted(p.versions.items()))},
    )


def without_folders(pf: ParameterFile) -> ParameterFile:
    """The file with its commands as `file_names_only` gives them, for a card that others read."""
    p = pf.provenance
    short = p.model_copy(
        update={"command": p.command and file_names_only(p.command), "then": tuple(map(file_names_only, p.then))}
    )
    return pf.model_copy(update={"provenance": short})


def file_names_only(command: str) -> str:
    """The command with the last name of each path in it; a command without paths, or not of a shell, as it is.

    >>> file_names_only("fitmodels '/home/an na/test 1.csv' --out /mnt/x/fit --units V=ft/min")
    "fitmodels 'test 1.csv' --out fit --units V=ft/min"
    """
    try:
        words = shlex.split(command)
    except ValueError:
        return command
    short = [_last_name(word, before) for before, word in zip(["", *words], words, strict=False)]
    return command if short == words else shlex.join(short)


def _last_name(word: str, before: str) -> str:
    option, equals, value = word.partition("=") if word.startswith("--") else ("", "", word)
    path = value.replace("\\", "/")
    last = path.rstrip("/").rpartition("/")[2]
    if "/" in path and (ABSOLUTE.match(path) or before == "--out" or ("." in last and "=" not in value)):
        return f"{option}{equals}{last}"
    return word


def checksum(pf: ParameterFile) -> str:
    """The file's own checksum, or the one it would have."""
    return pf.content_sha256 or content_sha256(pf.model_dump(exclude_unset=True))


def slug(pf: ParameterFile) -> str:
    """Name of a card in files and links: small letters, digits and hyphens of tool and work.

    >>> from fitmodels import parameters
    >>> slug(parameters.collect(tool="GC435", work="709M40 (En 19)"))
    'gc435-709m40-en-19'
    """
    return "-".join(_slug(name) for name in (pf.identity.tool, pf.identity.work))


def missing_identity(identity: IdentityPart) -> list[str]:
    """Names of the facts on the set-up that the file does not give."""
    given = {
        "machine": identity.machine,
        "ISO 513 group of the work": identity.iso513,
        "set-up": identity.setup,
        "properties of the tool (ISO 13399)": identity.tool_properties,
        "sensors": identity.sensors,
    }
    return [name for name, value in given.items() if not value]


def _slug(name: str) -> str:
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    kept = re.sub(r"[^a-z0-9]+", "-", plain).strip("-")[:LONGEST].strip("-")
    return kept or "x" + hashlib.sha256(name.encode()).hexdigest()[:8]  # a name in letters that no link takes


def _property(name: str, value: float | str) -> FactPart:
    if isinstance(value, str):
        return FactPart(name=name, number=NumberPart(), words=value)
    return FactPart(name=name, number=figure(value, 6))


def _sensor(rate: float | None, sd: float | None, unit: str) -> str:
    parts = [f"{quantity(figure(rate, 6, 'Hz'))}" if rate else "", f"SD of a reading {quantity(figure(sd, 3, unit))}"]
    return ", ".join(part for part in (parts if sd else parts[:1]) if part)
