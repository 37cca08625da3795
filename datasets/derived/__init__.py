"""Quantities computed from others of a file, with the formula, and their comparison with measured ones.

The note of a law states that its response was computed, and how: the parameter file has no field of it.
"""

from collections.abc import Iterable
from typing import Final

COMPUTED: Final = " is computed, not measured: "  # between the response and the equation
OF_CUT: Final = "the power of the cut, without the losses of the drive"


def computed_by(response: str, notes: Iterable[str]) -> str:
    """Equation by which the response of a law was computed, by the notes of the law; empty where it was measured.

    Examples
    --------
    >>> computed_by("P", ["P is computed, not measured: P = Fc V/60000; its law is that of Fc with this equation"])
    'P = Fc V/60000'
    """
    head = f"{response}{COMPUTED}"
    return next((note.removeprefix(head).partition(";")[0] for note in notes if note.startswith(head)), "")
