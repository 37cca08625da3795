"""What failed, as a sentence: of an expected error its own; of any other that it is a defect of this program."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from ..core.errors import FitmodelsError

T = TypeVar("T")

DEFECT = "a defect of fitmodels, not of the data"
GONE = "the source holds no row of this pair any more: it changed after it was looked over. Run it again."


@dataclass(frozen=True, slots=True)
class Failed:
    """Why something was not had; ``expected`` where the data are to blame."""

    reason: str
    expected: bool


def tried(work: Callable[[], T]) -> T | Failed:
    """What ``work`` gives, or why it gives nothing; only a lack of memory is not caught.

    Examples
    --------
    >>> tried(lambda: 1 / 0).reason
    'a defect of fitmodels, not of the data: ZeroDivisionError: division by zero.'
    """
    try:
        return work()
    except MemoryError:
        raise
    except FitmodelsError as error:
        return Failed(str(error), True)
    except Exception as error:
        return Failed(sentence(error), False)


def sentence(error: Exception) -> str:
    """An unexpected error in words, on one line.

    Examples
    --------
    >>> sentence(TypeError("no"))
    'a defect of fitmodels, not of the data: TypeError: no.'
    """
    words = " ".join(str(error).split())[:500].rstrip(".")
    return f"{DEFECT}: {type(error).__name__}{f': {words}' if words else ''}."
