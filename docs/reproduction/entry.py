"""One row of the reproduction ledger: printed value, computed value and verdict."""

from dataclasses import dataclass
from typing import Literal

Verdict = Literal["reproduced", "corrected with proof", "reconstructed", "not computable"]


@dataclass(frozen=True, slots=True)
class Entry:
    """A printed and a computed value.

    Attributes
    ----------
    place : str
        Location in the paper: ``Table 1, row 11``.
    quantity : str
        Description with the symbols of the paper.
    printed : float or str
        As printed: a string keeps its digits, ``"217500"``, ``"0.0611"``.
    ours : float or None
        From the running code at full precision; None where it is not computable.
    unit : str
    verdict : str
    why : str
        Proof of a correction, assumption of a reconstruction, or reason; may be empty when reproduced.
    """

    place: str
    quantity: str
    printed: float | str
    ours: float | None
    unit: str
    verdict: Verdict
    why: str = ""
