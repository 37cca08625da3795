"""A result that could not be computed, with the reason; never a NaN."""

import os
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from ..core.display import Displayable
from ..core.errors import FitmodelsError

T = TypeVar("T")


@dataclass(frozen=True, slots=True, repr=False)
class NotAvailable(Displayable):
    """A diagnostic that these data do not allow, with the reason; false in a condition.

    Attributes
    ----------
    reason : str
    failed : bool
        Whether the computation raised an error that these data do not explain.

    Examples
    --------
    >>> NotAvailable("no replicated edges: pure error unknown") or "nothing"
    'nothing'
    """

    reason: str
    failed: bool = False

    def __bool__(self) -> bool:
        return False

    def __str__(self) -> str:
        return self.reason


def computed(make: Callable[[], T], raised: tuple[type[Exception], ...] = (OSError,)) -> T | NotAvailable:
    """The result of an optional computation, or its error as the reason why there is none.

    An optional result must not end the run, whatever is wrong with it. With FITMODELS_TRACEBACK=1 in the environment
    the traceback of an unexpected error is printed.

    Parameters
    ----------
    make : callable
    raised : tuple of exception types
        Errors that end the run all the same: a file that cannot be written, or also an option that does not exist.

    Examples
    --------
    >>> computed(lambda: 1 / 0)
    NotAvailable: the computation failed (ZeroDivisionError: division by zero)
    >>> computed(lambda: 1 / 0).failed, NotAvailable("the computation failed to converge: few rows").failed
    (True, False)
    """
    try:
        return make()
    except raised:
        raise
    except FitmodelsError as error:
        return NotAvailable(str(error).rstrip("."))
    except Exception as error:
        if os.environ.get("FITMODELS_TRACEBACK"):
            traceback.print_exc()
        return NotAvailable(f"the computation failed ({type(error).__name__}: {error})", failed=True)
