"""Lines on the data behind a parameter file: names of files, corrections and rows that were left out."""

import shlex
from typing import Final

from ..core.text import in_ascii
from .file import ParameterFile

SIGNS: Final = " ._+-/,:=()"
LONGEST: Final = 80  # characters of a line


def data_lines(pf: ParameterFile) -> tuple[str, ...]:
    """The lines of a file, for a comment of any format; none where it names no data.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> pf = parameters.collect(tool="a", work="b", data_file="x.csv", options={"correct": ["lines 9:I/1000"]})
    >>> data_lines(pf)
    ('data x.csv', 'corrected lines 9:I/1000')
    """
    origin = pf.provenance
    files = [origin.data_file, *(one.data_file for one in origin.merged), *(_record(then) for then in origin.then)]
    said = {
        "data": dict.fromkeys(name for name in files if name),
        "corrected": corrections(pf, "correct"),
        "left out": corrections(pf, "leave_out"),
    }
    return tuple(_shown(f"{name} {', '.join(of)}") for name, of in said.items() if of)


def corrections(pf: ParameterFile, option: str) -> list[str]:
    """Values of the option ``correct`` or ``leave_out`` with which the data were read."""
    given = pf.provenance.options.get(option)
    return [str(one) for one in (given if isinstance(given, list) else [given]) if one]


def _record(command: str) -> str:
    """Name of the record of a command ``fitmodels ident``; empty for others."""
    try:
        words = shlex.split(command)
    except ValueError:
        return ""
    return words[2].replace("\\", "/").rpartition("/")[2] if words[1:2] == ["ident"] and len(words) > 2 else ""


def _shown(text: str) -> str:
    return in_ascii(text.replace("*", " x "), SIGNS)[:LONGEST].strip()
