"""One line of the reproduction ledger: what a paper prints, what the running code gives, and the verdict."""

from dataclasses import dataclass
from typing import Literal

Verdict = Literal["reproduced", "corrected with proof", "reconstructed", "not computable"]


@dataclass(frozen=True, slots=True)
class Entry:
    """A printed number and ours.

    Attributes
    ----------
    place : str
        Where it is printed: ``Table 1, row 11``.
    quantity : str
        What it is, in words and the paper's letters.
    printed : float or str
        As it stands in print: a string keeps its digits, ``"217500"``, ``"0.0611"``.
    ours : float or None
        From the running code at full precision; None where it is not computable.
    unit : str
    verdict : str
    why : str
        The proof of a correction, what was reconstructed, or why it is not computable; may be empty when reproduced.
    """

    place: str
    quantity: str
    printed: float | str
    ours: float | None
    unit: str
    verdict: Verdict
    why: str = ""
