"""One row of the reproduction ledger: printed value, computed value, verdict and kind."""

from dataclasses import dataclass
from typing import Literal, get_args

Verdict = Literal[
    "reproduced", "corrected with proof", "not reproduced", "derived", "reconstructed", "not computable"
]  # fmt: skip
Kind = Literal["finding", "identity", "assumption", "input"]
VERDICTS: tuple[str, ...] = get_args(Verdict)
KINDS: tuple[str, ...] = get_args(Kind)
ASSUMED = ("reconstructed",)


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
    ours : float, tuple of two floats or None
        From the running code at full precision, or the two ends of a range; None where it is not computable.
    unit : str
    verdict : str
    why : str
        Proof of a correction, assumption of a reconstruction, or reason; may be empty when reproduced.
    kind : str
        By default an input where nothing is computed, an assumption where the value is reconstructed, else a finding.
    """

    place: str
    quantity: str
    printed: float | str
    ours: float | tuple[float, float] | None
    unit: str
    verdict: Verdict
    why: str = ""
    kind: Kind | None = None

    def __post_init__(self) -> None:
        """Complete the kind."""
        if self.kind is None:
            computed: Kind = "assumption" if self.verdict in ASSUMED else "finding"
            object.__setattr__(self, "kind", "input" if self.ours is None else computed)
