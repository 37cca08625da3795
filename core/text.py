r"""Text of files as the program prints and writes it: without control characters, on one line, in ASCII, as JSON.

What a file says is printed at a terminal, on a page, in a comment of an export and in a table for spreadsheets. These
functions make it harmless there; each output calls them where the text leaves the program, so that a name is kept as
it is within it.
"""

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final

MARK: Final = "\N{REPLACEMENT CHARACTER}"  # stands for a character that is not shown
# Soft hyphen, zero-width spaces and joiners, direction marks and overrides, fillers, variation selectors, byte order
# mark, DEL and the C1 controls but NEL, which ends a line: the inside of a class of `re`.
INVISIBLE: Final = (
    "\u00ad\u034f\u061c\u115f\u1160\u17b4\u17b5\u180b-\u180f\u200b-\u200f\u202a-\u202e\u2060-\u206f\u3164"
    "\ufe00-\ufe0f\ufeff\uffa0\ufff9-\ufffc\x7f-\x84\x86-\x9f"
)
NARROWEST, WIDEST = 60, 120  # columns of a terminal; a sentence needs no more than the second
LONGEST_WORD: Final = 40  # lines without a blank
WORD_OF_A_LINE: Final = 50  # characters
LONGEST_MESSAGE: Final = 20_000  # characters
LONGEST_LINE: Final = 2_000
_OTHERS = (  # C0 but tab and newline, NEL, separators of lines, surrogates, non-characters, tags and shorthand
    "\x00-\x08\x0b-\x1f\x85\u2028\u2029\ud800-\udfff\ufdd0-\ufdef\ufffe\uffff"
    "\U0001bca0-\U0001bca3\U0001d173-\U0001d17a\U000e0000-\U000e0fff"
)
_UNSAFE = re.compile(f"[{INVISIBLE}{_OTHERS}]")
_SHOWN = bytes([9, 10, *range(32, 127)])  # tab, newline and what ASCII shows
_FORMULA = re.compile(r"'*[=+\-@\t\r].", re.DOTALL)  # what a spreadsheet would compute


def printable(text: str, mark: str = MARK) -> str:
    r"""The text with a mark for each character that is not shown or acts on a terminal; newlines and tabs stay.

    Parameters
    ----------
    text : str
    mark : str
        In place of control characters and escape sequences, direction marks, zero-width characters, separators of
        lines and unpaired surrogates.

    Examples
    --------
    >>> printable("GC435\x1b[2J \u202eabc", "?")
    'GC435?[2J ?abc'
    """
    return text if (text.isascii() and text.isprintable()) or _is_safe(text) else _UNSAFE.sub(mark, text)


def _is_safe(text: str) -> bool:
    """Whether nothing in a text is to be marked: shown ASCII is dropped at once, the few others are compared."""
    others = text.encode("utf-8", "surrogatepass").translate(None, _SHOWN)
    return not others or _UNSAFE.search(others.decode("utf-8", "surrogatepass")) is None


def one_line(text: object, mark: str = MARK) -> str:
    r"""A text on one line, with a mark for each character that is not shown.

    >>> one_line("a\n\n b\x1b", "?")
    'a b?'
    """
    return printable(" ".join(str(text).split()), mark)


def shortened(text: str, limit: int = 40) -> str:
    r"""A name or value for a message: printable, and cut to ``limit`` characters.

    >>> shortened("a\nb\x1b" + "x" * 100, 12)
    'a?b?xxxxx...'
    """
    text = "".join(c if c.isprintable() else "?" for c in printable(text[: limit + 1], "?"))
    return text if len(text) <= limit else text[: limit - 3] + "..."


def printable_message(sentence: str) -> str:
    r"""A message with values of a file in it: printable, of limited length, lines after the first indented.

    So no value begins a line that could pass for another message.

    >>> printable_message("column 'f\x1b\nfitmodels: done'") == "column 'f\N{REPLACEMENT CHARACTER}\n  fitmodels: done'"
    True
    """
    first, *others = _cut(sentence, LONGEST_MESSAGE).strip().splitlines() or [""]
    lines = [first, *(line if line.startswith(" ") else f"  {line}" for line in others)]
    return printable("\n".join(_cut(line, LONGEST_LINE) for line in lines))


def _cut(text: str, most: int) -> str:
    """Text without its middle where it is longer than ``most``: the file stands at its begin, what to do at its end."""
    if len(text) <= most:
        return text
    half = most // 2
    return f"{text[:half]} ... ({len(text) - 2 * half} more characters) ... {text[-half:]}"


def without_long_words(lines: Iterable[str]) -> Iterator[str]:
    """Lines of a screen without those between `LONGEST_WORD` ones of a single word: of a cell of a megabyte.

    >>> len([*without_long_words(["x" * 100] * 10_000)])
    41
    """
    run = 0
    for line in lines:
        word = line.strip()
        run = run + 1 if len(word) >= WORD_OF_A_LINE and " " not in word else 0
        if run <= LONGEST_WORD:
            yield line
        elif run == LONGEST_WORD + 1:
            yield "..."


def line_spans(lines: Sequence[int]) -> list[str]:
    """Lines in rising order, neighbours as ``2-9``.

    >>> line_spans([2, 3, 4, 9])
    ['2-4', '9']
    """
    out: list[list[int]] = []
    for line in lines:
        if out and line == out[-1][-1] + 1:
            out[-1] = [out[-1][0], line]
        else:
            out.append([line])
    return ["-".join(map(str, part)) for part in out]


def in_ascii(text: str, signs: str, mark: str = "_") -> str:
    """Text of ASCII letters, digits and ``signs`` alone, for a comment or value of a format; a mark for the others.

    >>> in_ascii('x*/ "; M30 (', " ;")
    'x__ _; M30 _'
    """
    return "".join(c if c.isascii() and (c.isalnum() or c in signs) else mark for c in text)


def json_text(data: Any, **options: Any) -> str:  # noqa: ANN401
    r"""Data as JSON in which no character acts on a terminal: they are written as ``\u001b``, so nothing is lost.

    Parameters
    ----------
    data : object
        Of finite numbers.
    **options
        Of `json.dumps`.

    Raises
    ------
    ValueError
        A number is not finite.

    Examples
    --------
    >>> json_text({"tool": "µ\x9b\u202e"})
    '{"tool": "µ\\u009b\\u202e"}'
    """
    return escaped(json.dumps(data, ensure_ascii=False, allow_nan=False, **options))


def escaped(written: str) -> str:
    """JSON that another library has written, as `json_text` writes it."""
    return written if _is_safe(written) else _UNSAFE.sub(lambda found: json.dumps(found[0])[1:-1], written)


def spreadsheet_cell(text: str) -> str:
    r"""A text of a table for spreadsheets: one that would be computed as a formula gets an apostrophe before it.

    >>> spreadsheet_cell("=cmd|' /C calc'!A0"), spreadsheet_cell("'-x"), spreadsheet_cell("GC435")
    ("'=cmd|' /C calc'!A0", "''-x", 'GC435')
    """
    return f"'{printable(text)}" if _FORMULA.match(text) else printable(text)
