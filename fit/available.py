"""A diagnostic that could not be computed, with the reason; never a NaN."""

from dataclasses import dataclass

from ..core.display import Displayable


@dataclass(frozen=True, slots=True, repr=False)
class NotAvailable(Displayable):
    """A diagnostic that these data do not allow, with the reason; false in a condition.

    Examples
    --------
    >>> NotAvailable("no replicated edges: pure error unknown") or "nothing"
    'nothing'
    """

    reason: str

    def __bool__(self) -> bool:
        return False

    def __str__(self) -> str:
        return self.reason
