"""Whose parameters a file holds, and where its numbers come from."""

import re
from datetime import datetime
from typing import Annotated

from pydantic import Field, JsonValue, field_validator

from ..errors import short
from .base import Count, Name, Number, Positive, Section, Sha256, Text

ISO513 = r"^[PMKNSH](0[1-9]|[1-4][0-9]|50)?$"
ISO13399 = re.compile(r"[A-Z][A-Z0-9_]{0,31}")


class Sensor(Section):
    """A sensor of the set-up: the symbol it measures, its unit, and what is known of it.

    Examples
    --------
    >>> Sensor(symbol="I", unit="A", model="hall sensor on the spindle drive", sample_rate=50.0).unit
    'A'
    """

    symbol: Name
    unit: str
    model: str | None = None
    sample_rate: Positive | None = None  # Hz
    sd: Annotated[float, Field(strict=True, ge=0)] | None = None  # of one reading, in ``unit``


class IdentitySection(Section):
    """Whose parameters these are; ``simulated`` when the data came from a simulation.

    Attributes
    ----------
    tool, work, machine, setup, note : str
        Tool and work material are needed; how the tool was held and the work clamped is ``setup``.
    iso513 : str or None
        Work-material group of ISO 513 (P, M, K, N, S or H), with the application number where it is known: ``P20``.
    iso13399 : dict
        Properties of the tool by their symbols in ISO 13399, ``{"DC": 2.0, "ZEFP": 2}``.
    sensors : tuple of Sensor

    Examples
    --------
    >>> IdentitySection(tool="GC435", work="709M40", simulated=False, iso513="P35").iso513
    'P35'
    """

    tool: Name
    work: Name
    machine: str | None = None
    simulated: bool = Field(strict=True)
    note: str | None = None
    iso513: str | None = None
    iso13399: dict[str, Number | Name] = Field(default_factory=dict)
    setup: str | None = None
    sensors: tuple[Sensor, ...] = ()

    @field_validator("iso513")
    @classmethod
    def _is_a_group(cls, group: str | None) -> str | None:
        if group is not None and not re.fullmatch(ISO513[1:-1], group):
            raise ValueError(f"{short(group)} is no group of ISO 513: P, M, K, N, S or H, or with its number as P20")
        return group

    @field_validator("iso13399")
    @classmethod
    def _are_symbols(cls, properties: dict[str, float | str]) -> dict[str, float | str]:
        for symbol in properties:
            if not ISO13399.fullmatch(symbol):
                raise ValueError(f"{short(symbol)} is no symbol of ISO 13399, which are capitals such as DC or ZEFP")
        return properties


class ProvenanceSection(Section):
    """Where the numbers come from: the data, the program and how it was called.

    Attributes
    ----------
    fitmodels : str
        Version of the program.
    versions : dict of str
        Versions of python, numpy and scipy.
    data_file, data_sha256, n_rows
        Name (no folder), checksum and number of rows of the data file.
    created : str or None
        ISO date, as it was given.
    command, options, seed
        How it was called.
    then : tuple of str
        Commands that put further sections in since, in their order.

    Examples
    --------
    >>> ProvenanceSection(fitmodels="0.1.0", data_file="data.csv", n_rows=120).n_rows
    120
    """

    created: str | None = None
    data_file: str | None = None
    data_sha256: Sha256 | None = None
    n_rows: Count | None = None
    fitmodels: Text
    versions: dict[str, str] = Field(default_factory=dict)
    command: str | None = None
    options: dict[str, JsonValue] = Field(default_factory=dict)
    then: tuple[str, ...] = ()
    seed: Count | None = None

    @field_validator("created")
    @classmethod
    def _is_a_date(cls, created: str | None) -> str | None:
        if created is not None:
            try:
                datetime.fromisoformat(created)
            except ValueError:
                raise ValueError(f"{short(created)} is not an ISO date such as 2024-05-01") from None
        return created

    @field_validator("data_file")
    @classmethod
    def _is_a_name(cls, name: str | None) -> str | None:
        if name is not None and (name in ("", ".", "..") or re.search(r"[/\\\0]", name)):
            raise ValueError(f"{short(name)} is not the name of a file alone, without its folder")
        return name
