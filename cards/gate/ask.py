"""The fields of card.toml: what each is, why a reader needs it, and an example."""

from dataclasses import dataclass

from ...datasets.vocabulary import UNNAMED


@dataclass(frozen=True, slots=True)
class Missing:
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
class Question:
    """A field of card.toml: why, what it is, an example, and the line to fill in."""

    why: str
    ask: str
    example: str
    line: str


QUESTIONS: dict[str, Question] = {
    "license": Question(
        "without a licence nobody may use the numbers",
        "SPDX identifier of the licence, from https://spdx.org/licenses; LicenseRef-Name for terms of your own.",
        'license = "CC-BY-4.0"',
        'license = ""',
    ),
    "authors": Question(
        "somebody answers for the numbers",
        'Persons as "Family, Given", with an ORCID in brackets if you like; institutions as they are called.',
        'authors = ["Doe, Jane (0000-0002-1825-0097)", "Institute of Machining"]',
        "authors = []",
    ),
    "contact": Question(
        "a reader who finds an error, or has more tests, must reach somebody",
        "An address of mail or of a page.",
        'contact = "jane.doe@example.org"',
        'contact = ""',
    ),
    "machine": Question(
        "stiffness, spindle and drive are part of every number",
        'Make and model; for a simulation say so: "none, simulated".',
        'machine = "Colchester Mascot lathe, 7.5 kW"',
        'machine = ""',
    ),
    "iso513": Question(
        "cards are compared within groups of work material",
        "Group of ISO 513 (P steel, M stainless, K cast iron, N non-ferrous, S superalloys and titanium, H hardened),"
        " with its number where you know it.",
        'iso513 = "P20"',
        'iso513 = ""',
    ),
    "setup": Question(
        "clamping, overhang and coolant decide whether the numbers carry over",
        "How the tool was held and the work clamped; coolant or dry; geometry that the tool's name does not tell.",
        'setup = "holder PSBNR 2525, overhang 30 mm; bar between chuck and centre; dry"',
        'setup = ""',
    ),
    "sensors": Question(
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
    name: Missing(
        name,
        "a card is looked for by tool and work",
        f"Fit the data again with --{name} NAME, or name it in the file; card.toml cannot tell it.",
    )
    for name in UNNAMED
}
DATA = Missing(
    "data_sha256",
    "without its checksum nobody can tell which data were fitted",
    "Fit the data file again with fitmodels, which writes its checksum; card.toml cannot tell it.",
)
