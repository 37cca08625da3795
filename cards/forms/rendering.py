"""Templates and assets of the package, for Markdown and HTML, and the typesetting of numbers and text in HTML."""

import base64
import hashlib
import os
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from importlib.resources import files
from importlib.util import cache_from_source
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from markupsafe import Markup, escape

from ..content.parts import CoefficientPart, FactorRangePart, NumberPart

if TYPE_CHECKING:
    from jinja2 import BytecodeCache, Environment
    from jinja2.bccache import Bucket

UNITS = "mm/rev|mm/min|m/min|1/min|min|mm|µm|um|kW|kN|Nm|N|Hz|ms|s|V|A|%"
TYPESET = re.compile(
    r"(?P<doi>\b10\.\d{4,9}/[\w.;()/:-]*\w)"
    rf"|(?P<quantity>(?:\b\w{{1,3}} )?[-−+]?\d[\d.e+-]{{0,30}} (?:{UNITS})(?![\w/]))"
    r"|(?P<probability>\bp (?:[<=] ?)?\d?\.\d+(?:e-\d+)?)"
    r"|(?P<power_of_ten>[-−]?\d[\d.]{0,30}e-?\d+)"
    rf"|(?P<letters>\bU = k u\b|\b[uk] = \d[\d.e-]*(?: (?:{UNITS})(?![\w/]))?)"
)
LEVELS = " for "  # separates an equation from the level of the category that it is of
TOKEN = re.compile(r"(?P<number>\d+\.?\d*(?:e[+-]?\d+)?)|(?P<function>exp|ln)(?=\()|(?P<name>[^\W\d]\w*)")
POWER = re.compile(r"\^(-?[\d.]+(?:e[+-]?\d+)?)")
DOI = re.compile(r"(?:https?://(?:dx\.)?doi\.org/)?(10\.\d{4,9}/\S+)")
LONGEST = 24  # characters


def environment(*, autoescape: bool, **filters: Callable[..., object]) -> "Environment":
    """Jinja environment on the templates of the package, with these filters."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    made = Environment(
        loader=PackageLoader("fitmodels.cards"),
        autoescape=autoescape,  # noqa: S701  in Markdown the filters escape
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        bytecode_cache=_compiled_templates(),
    )
    made.filters.update(filters)
    return made


def _compiled_templates() -> "BytecodeCache":
    """Compiled templates in ``__pycache__`` beside the templates, as Python keeps its modules: compiling takes 0.1 s.

    One that is missing, damaged or of another source, Jinja or Python is compiled again.
    """
    from jinja2 import BytecodeCache, __version__

    class CompiledTemplates(BytecodeCache):
        def get_cache_key(self, name: str, filename: str | None = None) -> str:
            return cache_from_source(filename or name, optimization=re.sub(r"\W", "", f"jinja{__version__}"))

        def load_bytecode(self, bucket: "Bucket") -> None:
            with suppress(Exception):  # whatever a damaged file raises
                bucket.bytecode_from_string(Path(bucket.key).read_bytes())

        def dump_bytecode(self, bucket: "Bucket") -> None:
            path = Path(bucket.key)
            if not sys.dont_write_bytecode:
                with suppress(OSError):  # the package may be read-only
                    path.parent.mkdir(parents=True, exist_ok=True)
                    made = path.with_name(f"{path.name}.{os.getpid()}")
                    made.write_bytes(bucket.bytecode_to_string())
                    made.replace(path)

    return CompiledTemplates()


@lru_cache(maxsize=8)
def asset(name: str) -> str:
    """Text of a file in the folder of templates."""
    return files("fitmodels.cards").joinpath("templates", name).read_text("utf-8")


def checksum(text: str) -> str:
    """SHA-256 in base64, as a content security policy states it."""
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def number(n: NumberPart) -> Markup:
    """A number with its unit, which no line break parts."""
    unit = f'\u00a0<span class="unit">{escape(n.unit)}</span>' if n.unit and n.text else ""
    return Markup(f'<span class="number{_kept(n.text + n.unit)}">{escape(n.text)}{unit}</span>')  # noqa: S704  escaped


def interval(c: CoefficientPart) -> str:
    """Both ends, or nothing; on a narrow screen the line breaks between them."""
    return f"{c.low.text}\u00a0… {c.high.text}" if c.low.text else ""


def spread(f: FactorRangePart) -> Markup:
    """A factor's range: symbol, both ends, unit."""
    return Markup('<span class="number{}"><var>{}</var> {} to {}\u00a0<span class="unit">{}</span></span>').format(
        _kept(f.symbol + f.unit), f.symbol, f.low.text, f.high.text, f.unit
    )


def _kept(text: str) -> str:
    """Class of what no line break parts: not of a name longer than a line of a phone."""
    return " kept" if len(text) <= LONGEST else ""


def equation(text: str) -> Markup:
    """An equation typeset: names as variables, powers raised; what is read and copied is the text as it was.

    >>> print(equation("AW = 0.5 V^0.3"))
    <var>AW</var> = 0.5 <var>V</var><span class="hat">^</span><sup>0.3</sup>
    """
    text, separator, level = text.partition(LEVELS)
    out, at = [], 0
    for power in POWER.finditer(text):
        out += [_names(text[at : power.start()]), Markup('<span class="hat">^</span><sup>{}</sup>').format(power[1])]
        at = power.end()
    return Markup().join([*out, _names(text[at:]), escape(separator + level)])


@lru_cache(maxsize=2048, typed=True)  # the same sentences stand in many cards; Markup equals its text
def prose(text: str) -> Markup:
    """A sentence: numbers stay with their units, a p with its value, and a DOI is a link."""
    out, at = [], 0
    for found in TYPESET.finditer(text):
        out.append(escape(text[at : found.start()]))
        out.append(doi(found[0]) if found["doi"] else Markup(f'<span class="kept">{escape(found[0])}</span>'))  # noqa: S704
        at = found.end()
    return Markup().join([*out, escape(text[at:])])


def doi(text: str) -> Markup:
    """A DOI as a link to its resolver; anything else as it is."""
    found = DOI.fullmatch(text.strip())
    if found is None:
        return escape(text)
    address = f"https://doi.org/{quote(found[1], safe='/.:;()-_')}"
    return Markup('<a href="{}" rel="noopener noreferrer">{}</a>').format(address, text)


def anchor(index: int, prefix: str) -> str:
    """An id that holds no name from the file."""
    return f"{prefix}-{index}"


def data_block(text: str) -> Markup:
    """JSON for a script element: nothing in it can end the element or begin a comment."""
    for letter in "<>&\u2028\u2029":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return Markup(text)  # noqa: S704


def _names(text: str) -> Markup:
    out, at = [], 0
    for token in TOKEN.finditer(text):
        if token["name"]:
            out += [escape(text[at : token.start()]), Markup("<var>{}</var>").format(token[0])]
            at = token.end()
    return Markup().join([*out, escape(text[at:])])
