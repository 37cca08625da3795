"""Origin of a parameter file: identity of tool and work, design of the tests, provenance."""

import re
from typing import Annotated

from pydantic import Field, JsonValue, field_validator

from ..messages import short
from .base import Count, IsoDate, Name, Number, Positive, Section, Sha256, Text
from .law_parts import DroppedRows, Factor

ISO513 = r"^[PMKNSH](0[1-9]|[1-4][0-9]|50)?$"
ISO13399 = re.compile(r"[A-Z][A-Z0-9_]{0,31}")


class Sensor(Section):
    """A sensor of the set-up: the symbol it measures, its unit and its data.

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
    """Tool, work, machine and set-up.

    Attributes
    ----------
    tool, work, machine, setup, note : str
        Tool and work material are needed; how the tool was held and the work clamped is ``setup``.
    simulated : bool or None
        Whether the data came from a simulation; None where it is not known.
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
    simulated: Annotated[bool, Field(strict=True)] | None
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
                raise ValueError(f"{short(symbol)} is not a symbol of ISO 13399, which are capitals such as DC or ZEFP")
        return properties


class ReadingDoubt(Section):
    """A doubt about columns of the data file.

    Attributes
    ----------
    columns : tuple of str
        Symbols of the roles concerned, or headers of columns without a role.
    sentence : str
        What was seen, beside what is usual.
    remedy : str
        Options of the command that would correct the reading; empty where there is none.

    Examples
    --------
    >>> ReadingDoubt(columns=["VB"], sentence="VB 1.2 to 1.9 mm is unusual", remedy="--unit VB=um").remedy
    '--unit VB=um'
    """

    columns: tuple[Text, ...] = ()
    sentence: Text
    remedy: str = ""


class ReadingSection(Section):
    """Judgement of the data file: its doubts, none where every value is usual and the columns agree.

    Examples
    --------
    >>> ReadingSection(doubts=[{"columns": ["VB"], "sentence": "VB 1.2 to 1.9 mm is unusual"}]).doubts[0].columns
    ('VB',)
    """

    doubts: tuple[ReadingDoubt, ...] = ()


class MergedFile(Section):
    """A parameter file whose sections were merged into this one: its name, its checksum, and the sections taken.

    Examples
    --------
    >>> MergedFile(file="feeds.json", sections=["laws.VB"]).sections
    ('laws.VB',)
    """

    file: Text
    content_sha256: Sha256 | None = None
    data_file: str | None = None
    data_sha256: Sha256 | None = None
    sections: tuple[Text, ...]


class ProvenanceSection(Section):
    """Provenance: the data, the program and how it was called.

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
        Commands that added further sections since, in their order.
    merged : tuple of MergedFile
        Other parameter files that sections come from.

    Examples
    --------
    >>> ProvenanceSection(fitmodels="0.1.0", data_file="data.csv", n_rows=120).n_rows
    120
    """

    created: IsoDate | None = None
    data_file: str | None = None
    data_sha256: Sha256 | None = None
    n_rows: Count | None = None
    fitmodels: Text
    versions: dict[str, str] = Field(default_factory=dict)
    command: str | None = None
    options: dict[str, JsonValue] = Field(default_factory=dict)
    then: tuple[str, ...] = ()
    merged: tuple[MergedFile, ...] = ()
    seed: Count | None = None

    @field_validator("data_file")
    @classmethod
    def _is_a_name(cls, name: str | None) -> str | None:
        if name is not None and (name in ("", ".", "..") or re.search(r"[/\\\0]", name)):
            raise ValueError(f"{short(name)} is not the name of a file alone, without its folder")
        return name


FEW = 15  # levels that are listed; more of them are a range
OneOrMore = Annotated[int, Field(strict=True, ge=1, lt=2**63)]


class DesignFactor(Factor):
    """A factor of the tests: its range in ``unit``, and its distinct levels where they are few (at most 15).

    Examples
    --------
    >>> DesignFactor(symbol="f", quantity="feed", unit="mm/rev", low=0.25, high=0.5, levels=(0.25, 0.5)).low
    0.25
    """

    levels: Annotated[tuple[Number, ...], Field(max_length=FEW)] = ()


class DesignLevel(Section):
    """A level of the category that shifts the laws, with its numbers of rows and edges."""

    level: str
    rows: Count
    edges: Count | None = None


class LeftOutRows(DroppedRows):
    """Rows that laws did not use, and of which responses; ``lines`` are the first of them in the data file."""

    laws: tuple[Text, ...]


class EdgeFacts(Section):
    """Summary of the cutting edges of the tests.

    Attributes
    ----------
    edges : int
        Edges in the file.
    rows_least, rows_median, rows_most
        Rows of an edge.
    replicated, replicated_edges : int
        Settings tested with more than one edge, and the number of these edges.
    settings : int
        Distinct settings of the conditions that stay the same on every edge, which ``set_by_edge`` names.
    short, short_edges
        Edges with fewer than half the median rows, and the first of their names: they ended early.
    worn : int or None
        Edges of which some wear reached the criterion; None where wear or criterion is not known.
    """

    edges: OneOrMore
    rows_least: OneOrMore
    rows_median: Positive
    rows_most: OneOrMore
    set_by_edge: tuple[Text, ...] = ()
    settings: Count = 0
    replicated: Count = 0
    replicated_edges: Count = 0
    short: Count = 0
    short_edges: tuple[str, ...] = ()
    worn: Count | None = None


class Criterion(Section):
    """The wear at which an edge counts as worn out; ``source`` states its origin."""

    wear: Text
    value: Positive
    unit: str
    source: str = ""


class DesignSection(Section):
    """The tests behind the laws.

    Files of earlier versions lack this section; it came with schema version 1 and is optional, so that they stay
    valid and need no step.

    Attributes
    ----------
    rows : int
        Of the data, including those that no law uses.
    factors : tuple of DesignFactor
        Conditions, time, and any other factor of a law.
    plan : str or None
        Kind of plan, where the settings are those of one that is known: ``central composite`` ...
    edges : EdgeFacts or None
        None where no column names the edges.
    by, levels
        Category that shifts the laws, and its levels.
    left_out : tuple of LeftOutRows
        Rows that some law does not use, with the reason.
    criterion : Criterion or None
    understood : tuple of str
        Interpretation of the data file, one sentence each.

    Examples
    --------
    >>> feed = {"symbol": "f", "quantity": "feed", "unit": "mm/rev", "low": 0.1, "high": 0.4}
    >>> DesignSection(rows=12, factors=[feed]).rows
    12
    """

    rows: Count
    factors: tuple[DesignFactor, ...] = ()
    plan: str | None = None
    edges: EdgeFacts | None = None
    by: str | None = None
    levels: tuple[DesignLevel, ...] = ()
    left_out: tuple[LeftOutRows, ...] = ()
    criterion: Criterion | None = None
    understood: tuple[str, ...] = ()
