"""Names and texts sanitised for exports, so that text of a file cannot inject into a format."""

import re
import unicodedata
from textwrap import wrap

from ...core.text import in_ascii

LONGEST_NAME = 40  # characters; LinuxCNC's HAL ends at 47 with its prefix
LONGEST_TEXT = 80
SPELLED = {"µ": "u", "μ": "u", "°": "deg", "·": ".", "⋅": ".", "²": "2", "³": "3", "ß": "ss", "ø": "o", "Ø": "O"}


def _ascii(text: str) -> str:
    spelled = "".join(SPELLED.get(c, c) for c in text)
    kept = "".join(c for c in unicodedata.normalize("NFKD", spelled) if not unicodedata.combining(c))
    return kept.encode("ascii", "replace").decode()


def safe_name(text: str, fallback: str = "unnamed") -> str:
    """An identifier of lower-case letters, digits and single underscores that begins with a letter.

    >>> safe_name("GC435"), safe_name("../../x"), safe_name('"; M30 ('), safe_name("709M40")
    ('gc435', 'x', 'm30', 'n709m40')
    """
    name = re.sub(r"[^a-z0-9]+", "_", _ascii(text).lower()).strip("_")
    name = f"n{name}" if name[:1].isdigit() else name
    return name[:LONGEST_NAME].rstrip("_") or fallback


def plain(text: str) -> str:
    """Text for a comment or a quoted value of any format: letters, digits, space and ``. , _ + -`` alone, one line.

    >>> plain("GC435 / TiN"), plain("<script>"), plain("=cmd|' /C calc'!A0"), plain('x*)"; M30 (')
    ('GC435 _ TiN', '_script_', '_cmd__ _C calc__A0', 'x___ - M30 _')
    """
    return _shown(text)[:LONGEST_TEXT].strip() or "unnamed"


def plain_lines(text: str) -> tuple[str, ...]:
    """Sentences for comments, of letters, digits and ``. _ + - , : ; / = ( ) %`` alone, on as many lines as they need.

    Each format still removes what acts in its comments.

    >>> plain_lines("No edge is named: name the edges (a column) */ 'edge'.")
    ('No edge is named: name the edges (a column) _/ _edge_.',)
    >>> len(plain_lines("a sentence of more than eighty characters, which a comment of one line would shorten"))
    2
    """
    shown = in_ascii(_ascii(text), " ._+-,:;/=()%").lstrip("+-=")
    return tuple(line.strip() for line in wrap(shown, LONGEST_TEXT)) or ("unnamed",)


def plain_equation(text: str) -> str:
    """An equation in ASCII, without anything that ends a comment of C or a value of an ini file.

    >>> plain_equation("Ra = 2.1 (V/120)^-0.2 exp(0.3 ln(f/0.2)^2); V in m/min */ %")
    'Ra = 2.1 (V/120)^-0.2 exp(0.3 ln(f/0.2)^2) - V in m/min _/ _'
    """
    return re.sub(r"[^A-Za-z0-9 ._+/=^()-]", "_", re.sub(r"(?:(?<!\s)\s+)?;\s+", " - ", _ascii(text)))


def _shown(text: str) -> str:
    text = re.sub(r"(?:(?<!\s)\s+)?[:;]\s+", " - ", text)  # no format takes these for a command
    kept = re.sub(r",(?!\s)|[^A-Za-z0-9 ,._+-]", "_", _ascii(text))
    return re.sub(r"_{4,}", "___", kept).lstrip("+-, ")


def plain_unit(unit: str) -> str:
    """A unit in ASCII, with ``/`` and parentheses but without anything that ends a C, ST or XML text.

    >>> plain_unit("mm/min"), plain_unit("µm"), plain_unit("A*s */ (x"), plain_unit("")
    ('mm/min', 'um', 'A.s ./ (x', '1')
    """
    shown = re.sub(r"[^A-Za-z0-9 ./()^%+-]", "_", _ascii(unit).replace("*", "."))
    return shown[:LONGEST_NAME].strip() or "1"


def c_text(words: str) -> str:
    """Text that neither ends a comment of C or ST nor begins another, continues a line or spells a trigraph.

    >>> c_text("load in A; 50 % */ int x")
    'load in A; 50 % _/ int x'
    """
    return in_ascii(words, " ._+-/,:;=^()%")


def gcode_text(words: str) -> str:
    """Text of a comment of G-code: no parenthesis, which ends it.

    >>> gcode_text("V 120 m/min) M30 (")
    'V 120 m/min_ M30 _'
    """
    return in_ascii(re.sub(r"(?:(?<!\s)\s+)?[:;]\s+", " - ", words), " ._+-/,=^[]")
