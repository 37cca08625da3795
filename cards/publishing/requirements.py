"""Requirements for publishing a card: fields of card.toml, what a card lacks, a template, the result of the check."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ...core.errors import GateError
from ...datasets.vocabulary import UNNAMED
from ...parameters import ParameterFile
from ...parameters.checks import check
from ..content.parts import Card
from ..forms.markdown import one_line


@dataclass(frozen=True, slots=True)
class MissingField:
    """Something that a card must tell and does not.

    Attributes
    ----------
    field : str
        Its key in card.toml, or the name of what only a new fit can bring.
    why : str
        What a reader needs it for.
    ask : str
        The question, with what it is; for what card.toml cannot tell, what brings it.
    """

    field: str
    why: str
    ask: str


@dataclass(frozen=True, slots=True)
class FieldQuestion:
    """A field of card.toml: why, what it is, an example, and the line to fill in."""

    why: str
    ask: str
    example: str
    line: str


QUESTIONS: dict[str, FieldQuestion] = {
    "license": FieldQuestion(
        "without a licence nobody may use the numbers",
        "SPDX identifier of the licence, from https://spdx.org/licenses; LicenseRef-Name for terms of your own.",
        'license = "CC-BY-4.0"',
        'license = ""',
    ),
    "authors": FieldQuestion(
        "somebody answers for the numbers",
        'Persons as "Family, Given", with an ORCID in brackets if you like; institutions as they are called.',
        'authors = ["Doe, Jane (0000-0002-1825-0097)", "Institute of Machining"]',
        "authors = []",
    ),
    "contact": FieldQuestion(
        "a reader who finds an error, or has more tests, must reach somebody",
        "An address of mail or of a page.",
        'contact = "jane.doe@example.org"',
        'contact = ""',
    ),
    "machine": FieldQuestion(
        "stiffness, spindle and drive are part of every number",
        'Make and model; for a simulation say so: "none, simulated".',
        'machine = "Colchester Mascot lathe, 7.5 kW"',
        'machine = ""',
    ),
    "iso513": FieldQuestion(
        "cards are compared within groups of work material",
        "Group of ISO 513 (P steel, M stainless, K cast iron, N non-ferrous, S superalloys and titanium, H hardened),"
        " with its number where you know it.",
        'iso513 = "P20"',
        'iso513 = ""',
    ),
    "setup": FieldQuestion(
        "clamping, overhang and coolant decide whether the numbers carry over",
        "How the tool was held and the work clamped; coolant or dry; geometry that the tool's name does not tell.",
        'setup = "holder PSBNR 2525, overhang 30 mm; bar between chuck and centre; dry"',
        'setup = ""',
    ),
    "sensors": FieldQuestion(
        "a number is worth what its sensor is",
        "A block [[sensors]] for each thing measured: symbol and unit; model, sample_rate in Hz, and sd of one reading"
        " in the unit where known. Where there was none, say why in no_sensors.",
        'no_sensors = "wear read by eye at a toolmaker\'s microscope"',
        'no_sensors = ""',
    ),
}
SENSOR_EXAMPLE = (
    "[[sensors]]",
    'symbol = "AW"',
    'unit = "mm"',
    'model = "toolmaker\'s microscope, 30 x"',
    "sd = 0.005",
)
NAMES = {
    name: MissingField(
        name,
        "a card is looked for by tool and work",
        f"Fit the data again with --{name} NAME, or name it in the file; card.toml cannot tell it.",
    )
    for name in UNNAMED
}
DATA = MissingField(
    "data_sha256",
    "without its checksum nobody can tell which data were fitted",
    "Fit the data file again with fitmodels, which writes its checksum; card.toml cannot tell it.",
)


def missing_fields(card: Card) -> list[MissingField]:
    """Everything that is required and not told, in the order of card.toml.

    Required are licence, an author, contact, machine, ISO 513 group, set-up, a sensor or why there was none, names of
    tool and work, and the checksum of the data.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.card import compose
    >>> [item.field for item in missing_fields(compose(parameters.collect(tool="GC435", work="709M40")))]
    ['license', 'authors', 'contact', 'machine', 'iso513', 'setup', 'sensors', 'data_sha256']
    """
    p, i = card.publication, card.identity
    told = {
        "license": p.license,
        "authors": "".join(p.authors),
        "contact": p.contact,
        "machine": i.machine,
        "iso513": i.iso513,
        "setup": i.setup,
    }
    lacking = [name for name, value in told.items() if not value.strip()] + ([] if i.sensors else ["sensors"])
    asked = [MissingField(name, QUESTIONS[name].why, QUESTIONS[name].ask) for name in lacking]
    unnamed = [NAMES[name] for name, nothing in UNNAMED.items() if getattr(i, name) == nothing]
    return [*asked, *unnamed, *([] if card.provenance.data_sha256 else [DATA])]


def card_toml_template(card: Card) -> str:
    """The text of a card.toml that asks for what the card lacks; it reads back as it is, telling nothing yet.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.card import compose
    >>> print(card_toml_template(compose(parameters.collect(tool="GC435", work="709M40"))).splitlines()[0])
    # What the card of GC435 on 709M40 does not tell yet.
    """
    lacking = [item.field for item in missing_fields(card) if item.field in QUESTIONS]
    of = f"the card of {one_line(card.title)}"
    head = f"# What {of} does not tell yet." if lacking else f"# Nothing is missing: {of} may be published."
    return _asking(head, lacking)


def shared_template(pairs: int, fields: Sequence[str]) -> str:
    """The text of a card.toml above many pairs, which asks once for what none of them tells.

    >>> shared_template(40, ["license"]).splitlines()[0]
    '# What none of the 40 cards below tells yet. A card.toml beside a pair adds to this one and counts first.'
    """
    words = (
        f"What none of the {pairs} cards below tells yet. A card.toml beside a pair adds to this one and counts first."
    )
    return _asking(f"# {words}", fields)


def _asking(head: str, lacking: Sequence[str]) -> str:
    return "".join(f"{line}\n" for line in (head, *_questions(lacking)))


def _questions(lacking: Sequence[str]) -> Iterator[str]:
    for name in lacking:
        question = QUESTIONS[name]
        yield ""
        yield f"# {name}: {question.why}."
        yield f"# {question.ask}"
        yield f"# for example: {question.example}"
        yield question.line
    yield ""
    yield '# Also, if you like: title, doi, keywords = ["..."], a block [tool_properties] with symbols of ISO 13399.'
    if "sensors" in lacking:
        yield "# A sensor, at the end of the file:"
        yield from (f"# {line}" for line in SENSOR_EXAMPLE)


@dataclass(frozen=True, slots=True)
class PublicationCheck:
    """What a card lacks, and what is wrong with its parameter file.

    Attributes
    ----------
    title : str
    missing : tuple of Missing
        In the order of card.toml.
    refusals : tuple of str
        Findings of ``parameters.check`` that stand against the file, a shut posterior gate among them.
    """

    title: str
    missing: tuple[MissingField, ...]
    refusals: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether it may be published."""
        return not (self.missing or self.refusals)

    def sentences(self) -> list[str]:
        """Refusals, then what is missing with what it is needed for and how it is told."""
        asked = [
            f"{item.field}: {item.why}. {item.ask}"
            + (f" For example: {QUESTIONS[item.field].example}" if item.field in QUESTIONS else "")
            for item in self.missing
        ]
        return [*self.refusals, *asked]

    def raise_if_shut(self) -> None:
        """Raise `GateError` with everything in one sentence a line."""
        if not self.ok:
            n = len(self.missing) + len(self.refusals)
            against = "1 thing stands" if n == 1 else f"{n} things stand"
            head = f"{self.title} is not published: {against} against it."
            raise GateError("\n".join([head, *(f"- {words}" for words in self.sentences())]))


def check_publication(card: Card, pf: ParameterFile, folder: str | os.PathLike[str] | None = None) -> PublicationCheck:
    """Judge a card and the parameter file on disk that it was made from.

    Parameters
    ----------
    card : Card
        With what card.toml tells.
    pf : ParameterFile
        As it was read, without what card.toml tells.
    folder : path, optional
        Where the file stands, to look at its draws too.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> from fitmodels.cards.content.card import compose
    >>> pf = parameters.collect(tool="GC435", work="709M40")
    >>> report = check_publication(compose(pf), pf)
    >>> report.ok, len(report.missing), report.refusals
    (False, 8, ())
    """
    report = check(pf, folder)
    return PublicationCheck(card.title, tuple(missing_fields(card)), tuple(finding.words for finding in report.failed))
