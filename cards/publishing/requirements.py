"""Requirements for publishing a card: fields of card.toml, missing ones, a template, the result of the check."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ...core.text import one_line
from ...datasets.vocabulary import UNNAMED
from ...parameters import ParameterFile
from ...parameters.checks import check
from ..content.card import Card

SENSOR_EXAMPLE = (
    "[[sensors]]",
    'symbol = "AW"',
    'unit = "mm"',
    'model = "toolmaker\'s microscope, 30 x"',
    "sd = 0.005",
)


@dataclass(frozen=True, slots=True)
class MissingField:
    """A required fact that a card lacks.

    Attributes
    ----------
    field : str
        Its key in card.toml, or the name of what requires a new fit.
    why : str
        Why a reader needs it.
    ask : str
        A description of the entry; for a field that card.toml cannot give, the remedy.
    """

    field: str
    why: str
    ask: str


@dataclass(frozen=True, slots=True)
class FieldQuestion:
    """A field of card.toml: the reason for it, a description, an example."""

    why: str
    ask: str
    example: str

    @property
    def line(self) -> str:
        """The empty field."""
        key, _, value = self.example.partition(" = ")
        return f"{key} = " + ("[]" if value.startswith("[") else '""')


QUESTIONS: dict[str, FieldQuestion] = {
    "license": FieldQuestion(
        "without a licence the numbers must not be reused",
        "SPDX identifier of the licence, from https://spdx.org/licenses; LicenseRef-Name for terms of your own.",
        'license = "CC-BY-4.0"',
    ),
    "authors": FieldQuestion(
        "readers need to know who is responsible for the numbers",
        'Persons as "Family, Given", optionally with an ORCID in brackets; institutions by their name.',
        'authors = ["Doe, Jane (0000-0002-1825-0097)", "Institute of Machining"]',
    ),
    "contact": FieldQuestion(
        "readers need an address for errors and further tests",
        "An e-mail address or a web page.",
        'contact = "jane.doe@example.org"',
    ),
    "machine": FieldQuestion(
        "stiffness, spindle and drive affect every number",
        'Make and model; for a simulation: "none, simulated".',
        'machine = "Colchester Mascot lathe, 7.5 kW"',
    ),
    "iso513": FieldQuestion(
        "cards are compared within groups of work material",
        "Group of ISO 513 (P steel, M stainless, K cast iron, N non-ferrous, S superalloys and titanium, H hardened),"
        " with its number if known.",
        'iso513 = "P20"',
    ),
    "setup": FieldQuestion(
        "clamping, overhang and coolant determine whether the numbers apply elsewhere",
        "Tool holder and clamping of the work; coolant or dry; geometry that the name of the tool does not give.",
        'setup = "holder PSBNR 2525, overhang 30 mm; bar between chuck and centre; dry"',
    ),
    "sensors": FieldQuestion(
        "the accuracy of a number depends on its sensor",
        "A block [[sensors]] for each measured quantity: symbol and unit; model, sample_rate in Hz, and sd of one"
        " reading in the unit if known. Without sensors, give the reason in no_sensors.",
        'no_sensors = "wear read by eye at a toolmaker\'s microscope"',
    ),
}
NAMES = {
    name: MissingField(
        name,
        "cards are searched by tool and work",
        f"Fit the data again with --{name} NAME, or name it in the file; card.toml cannot give it.",
    )
    for name in UNNAMED
}
DATA = MissingField(
    "data_sha256",
    "without its checksum the fitted data cannot be identified",
    "Fit the data file again with fitmodels, which writes its checksum; card.toml cannot give it.",
)


def missing_fields(card: Card) -> list[MissingField]:
    """Required facts that a card lacks, in the order of card.toml.

    Required are licence, an author, contact, machine, ISO 513 group, set-up, a sensor or the reason for having none,
    names of tool and work, and the checksum of the data.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.card import compose
    >>> [item.field for item in missing_fields(compose(parameters.collect(tool="GC435", work="709M40")))]
    ['license', 'authors', 'contact', 'machine', 'iso513', 'setup', 'sensors', 'data_sha256']
    """
    p, i = card.publication, card.identity
    given = {"license": p.license, "authors": "".join(p.authors), "contact": p.contact}
    given |= {"machine": i.machine, "iso513": i.iso513, "setup": i.setup}
    lacking = [name for name, value in given.items() if not value.strip()] + ([] if i.sensors else ["sensors"])
    asked = [MissingField(name, QUESTIONS[name].why, QUESTIONS[name].ask) for name in lacking]
    unnamed = [NAMES[name] for name, nothing in UNNAMED.items() if getattr(i, name) == nothing]
    return [*asked, *unnamed, *([] if card.provenance.data_sha256 else [DATA])]


def card_toml_template(card: Card) -> str:
    """The text of a card.toml with empty fields for what the card lacks.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.card import compose
    >>> print(card_toml_template(compose(parameters.collect(tool="GC435", work="709M40"))).splitlines()[0])
    # Missing in the card of GC435 on 709M40:
    """
    lacking = [item.field for item in missing_fields(card) if item.field in QUESTIONS]
    of = f"the card of {one_line(card.title)}"
    return _template(f"Missing in {of}:" if lacking else f"Nothing is missing in {of}.", lacking)


def shared_template(pairs: int, fields: Sequence[str]) -> str:
    """The text of a card.toml for many pairs, with empty fields for what all of them lack.

    >>> shared_template(40, ["license"]).splitlines()[0]
    '# Missing in all of the 40 cards below. A card.toml in the folder of a pair has precedence over this one.'
    """
    precedence = "A card.toml in the folder of a pair has precedence over this one."
    return _template(f"Missing in all of the {pairs} cards below. {precedence}", fields)


def _template(head: str, lacking: Sequence[str]) -> str:
    return "".join(f"{line}\n" for line in (f"# {head}", *_questions(lacking)))


def _questions(lacking: Sequence[str]) -> Iterator[str]:
    for name in lacking:
        question = QUESTIONS[name]
        yield from ("", f"# {name}: {question.why}.", f"# {question.ask}", f"# for example: {question.example}")
        yield question.line
    yield ""
    yield '# Optional: title, doi, keywords = ["..."], a block [tool_properties] with symbols of ISO 13399.'
    if "sensors" in lacking:
        yield "# A sensor, at the end of the file:"
        yield from (f"# {line}" for line in SENSOR_EXAMPLE)


@dataclass(frozen=True, slots=True)
class PublicationCheck:
    """Missing fields of a card, and failed checks of its parameter file.

    Attributes
    ----------
    title : str
    missing : tuple of MissingField
        In the order of card.toml.
    refusals : tuple of str
        Failed checks of ``parameters.check``, among them those of convergence.
    """

    title: str
    missing: tuple[MissingField, ...]
    refusals: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether the card may be published."""
        return not (self.missing or self.refusals)


def check_publication(card: Card, pf: ParameterFile, folder: str | os.PathLike[str] | None = None) -> PublicationCheck:
    """Check a card and the parameter file on disk that it was made from.

    Parameters
    ----------
    card : Card
        With the metadata of card.toml.
    pf : ParameterFile
        As read from disk, without the metadata of card.toml.
    folder : path, optional
        Folder of the file, to check its draws too.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.card import compose
    >>> pf = parameters.collect(tool="GC435", work="709M40")
    >>> report = check_publication(compose(pf), pf)
    >>> report.ok, len(report.missing), report.refusals
    (False, 8, ())
    """
    refusals = tuple(finding.words for finding in check(pf, folder).failed)
    return PublicationCheck(card.title, tuple(missing_fields(card)), refusals)
