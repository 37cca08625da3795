"""What a diagnostic says when it cannot be had: the reason, never a NaN."""

from dataclasses import dataclass

from ..datasets.telling import Told


@dataclass(frozen=True, slots=True, repr=False)
class NotAvailable(Told):
    """A diagnostic that these data do not allow; false in a condition.

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
