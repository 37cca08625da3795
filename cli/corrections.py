"""The command as typed with the options of a remedy: an option that both give is taken from the remedy."""

import re
import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..datasets.options import merged, without
from .arguments import typed

if TYPE_CHECKING:
    from ..datasets import Runs

OPTION = re.compile(
    r"""--(?:map|unit|range|value|correct|leave-out|edge|process|decimal|sheet) """
    r"""(?!names |gives )(?:"[^"]*"|'[^']*'|[^\s"']+)|--hidden\b"""
)


def corrected(words: Sequence[str], remedy: str) -> str:
    """The whole command, to be copied.

    Parameters
    ----------
    words : sequence of str
        The command line as typed, without the program; the name of ``look`` is left out.
    remedy : str
        Options as typed, such as ``--unit VB=um``.

    Examples
    --------
    >>> corrected(["data.csv", "--unit", "VB=mm", "--force"], "--unit VB=um")
    'fitmodels data.csv --unit VB=um'
    >>> corrected(["look", "data.csv", "--out", "a.png", "--map", "V=vc x"], '--map "f=col 2"')
    "fitmodels data.csv --map 'V=vc x' --map 'f=col 2'"
    >>> corrected(["data.csv", "--correct", "E07:f*10"], '--correct "E07:f*25.4" --leave-out E11')
    "fitmodels data.csv --correct 'E07:f*25.4' --leave-out E11"
    >>> corrected(["data.csv"], "--map V=col2 --unit V=sfm --map V=col2")
    'fitmodels data.csv --map V=col2 --unit V=sfm'
    """
    try:
        added = shlex.split(remedy)
    except ValueError:  # a quote without its partner: as written
        return f"{typed(words)} {remedy}"
    look = list(words[:1]) == ["look"]
    kept = without(words[1:], "place", "screen") if look else without(words, "screen")
    return shlex.join(["fitmodels", *merged(kept, added)])


def explicit(runs: "Runs") -> str:
    """Options that state the units which the file does not name; empty where it names all of them.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> explicit(datasets.read_runs(datasets.bundled("gc435_709m40")))
    ''
    """
    named = [use.role for use in runs.columns if use.role is not None and not use.unit and runs.units.get(use.role)]
    return " ".join(f"--unit {shlex.quote(f'{role}={runs.units[role]}')}" for role in named)


def remedies_in(message: str) -> list[str]:
    """Options that a message proposes, one text for each alternative; none where it gives an example.

    >>> remedies_in("VB 66 to 387 mm cannot be; 66 to 387 um can: --unit VB=um.")
    ['--unit VB=um']
    >>> remedies_in("V: --unit V=sfm or --unit V=m/min; d: --unit d=in or --unit d=mm.")
    ['--unit V=sfm --unit d=in', '--unit V=m/min --unit d=mm']
    >>> remedies_in("100 to 400 um/rev can: --unit f=um/rev or as feed rate, --map fm=col3 --unit fm=mm/min.")
    ['--unit f=um/rev', '--map fm=col3 --unit fm=mm/min']
    >>> remedies_in("--edge names a column 'Insert' that the file does not have.")
    []
    """
    if "for instance" in message or "..." in message:
        return []
    clauses = []
    for clause in re.split(r"[;.] ", message):
        either = [[found.group().rstrip(".,;:)") for found in OPTION.finditer(part)] for part in clause.split(" or ")]
        if any(either):
            clauses.append([" ".join(options) for options in either if options])
    most = max(map(len, clauses), default=0)
    alternatives = (" ".join(either[min(k, len(either) - 1)] for either in clauses) for k in range(most))
    return list(dict.fromkeys(alternatives))
