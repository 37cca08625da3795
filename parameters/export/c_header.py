"""A C header: every number as a ``static const double``, C89 and C++ alike.

Numbers stand in the shortest digits that read back to the same double (17 at most).
"""

from .quantities import Quantity
from .view import View

CANNOT = (
    "units as types: they stand in comments",
    "the covariance, the posterior and text of the laws",
    "the loop itself: these are its constants; the st export is the loop",
    "exact values on a compiler whose double has fewer than 53 bits",
)


def render(view: View) -> str:
    """Give the header."""
    guard = f"FITMODELS_{view.name.upper()}_H"
    head = [
        f"{view.made_by}: tool {view.tool}, work {view.work}, machine {view.machine}",
        *(["SIMULATED data, not measured"] if view.simulated else []),
        f"parameter file {view.checksum}",
        *(f"assumed: {words}" for words in view.assumed),
        *(f"not carried: {words}" for words in CANNOT),
    ]
    return "\n".join([
        *(f"/* {_comment(words)} */" for words in head),
        f"#ifndef {guard}", f"#define {guard}", "",
        *(_line(q) for q in view.quantities), "",
        f"#endif /* {guard} */", "",
    ])  # fmt: skip


def _line(quantity: Quantity) -> str:
    words = _comment(f"{quantity.unit}: {quantity.words}")
    return f"static const double fm_{quantity.name} = {quantity.value!r}; /* {words} */"


def _comment(words: str) -> str:
    """Text that neither ends a C comment nor begins another, continues a line or spells a trigraph."""
    return "".join(c if c.isalnum() or c in " ._+-/,:;=^()%" else "_" for c in words)
