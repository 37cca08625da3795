"""Why a region is empty: the limits that exclude each other, and how near the others let a response come."""

from collections.abc import Collection, Sequence
from math import exp

from .clipping import HalfPlane, conflict, everywhere, left_by


def exclusion(limits: Sequence[HalfPlane], sides: Sequence[HalfPlane], responses: Collection[str]) -> str:
    """The sentence; ``limits`` are those of responses and spindle, ``sides`` those of the machine's ranges."""
    among = conflict((*sides, *limits))
    names = [each.words for each in sorted(among, key=lambda each: each in limits)]
    head = f"{names[0]} is never met"
    if len(names) > 1:
        head = f"{', '.join(names[:-1])} and {names[-1]} exclude each other"
    for each in among:
        rest = left_by([other for other in among if other is not each], everywhere())
        if each.symbol in responses and len(rest):
            nearest = exp(float(each.beyond(rest).min())) * each.value
            return f"{head}: {each.symbol} is {nearest:.4g} {each.unit} there at best."
    return f"{head}."
