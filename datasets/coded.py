"""Coded levels of a design (-1, 0, 1) and the ranges that turn them into conditions.

Source: Box & Wilson 1951; in the papers' designs the levels are evenly spaced in the logarithm.
"""

import numpy as np
from numpy.typing import NDArray

from ..core.errors import DataError, UsageError

Values = NDArray[np.float64] | NDArray[np.object_]


def looks_coded(values: NDArray[np.float64]) -> bool:
    """Whether these are levels of a design: few, symmetric about zero, -1 and 1 among them.

    Examples
    --------
    >>> looks_coded(np.array([-1, 1, 0, 0, -1, 1.0])), looks_coded(np.array([50, 100, 200.0]))
    (True, False)
    """
    known = values[~np.isnan(values)]
    if not known.size or known.min() < -3 or known.max() > 3:  # the usual case, told without sorting
        return False
    levels = np.unique(known)
    if not 2 <= len(levels) <= 7 or not {-1.0, 1.0} <= set(levels):
        return False
    return bool(np.allclose(levels, -levels[::-1]))


def decode(role: str, values: Values, given: tuple[float, ...] | None) -> tuple[Values, tuple[str, ...]]:
    """Conditions from coded levels, and what was assumed; anything else is handed back as it is.

    Parameters
    ----------
    role : symbol, for the messages
    values : shape (n,)
    given : (low, high) at the levels -1 and 1, spaced evenly in the logarithm, or (low, centre, high)

    Raises
    ------
    DataError
        The levels are coded and no range is given.
    UsageError
        The range is not in order, or given for a column that is not coded.

    Examples
    --------
    >>> decode("V", np.array([-1, 0, 1.0]), (50.0, 200.0))[0].round(6).tolist()
    [50.0, 100.0, 200.0]
    """
    if values.dtype == object:
        return values, ()
    levels = np.asarray(values, dtype=float)
    if not looks_coded(levels):
        if given is not None:
            raise UsageError(f"--range {role}: the column holds no coded levels (-1, 0, 1); leave the range out.")
        return values, ()
    if given is None:
        raise DataError(
            f"{role} holds coded levels ({', '.join(f'{v:g}' for v in np.unique(levels[~np.isnan(levels)]))}): "
            f"say what -1 and 1 stand for, for instance --range {role}=50:200 (or low:centre:high)."
        )
    low, centre, high = _checked(role, given)
    if np.isclose(centre**2, low * high, rtol=0.02):
        how = f"{role}: coded levels, even in the logarithm: -1 is {low:g}, 0 is {centre:g}, 1 is {high:g}"
        return centre * (high / low) ** (levels / 2), (how,)
    how = f"{role}: coded levels, even in {role} itself: -1 is {low:g}, 0 is {centre:g}, 1 is {high:g}"
    return centre + levels * (high - low) / 2, (how,)


def _checked(role: str, given: tuple[float, ...]) -> tuple[float, float, float]:
    if len(given) not in (2, 3) or not (0 < given[0] < given[-1] < np.inf):
        raise UsageError(f"--range {role}={':'.join(f'{v:g}' for v in given)}: it is low:high, both above zero.")
    low, high = given[0], given[-1]
    centre = given[1] if len(given) == 3 else float(np.sqrt(low * high))
    geometric = np.isclose(centre**2, low * high, rtol=0.02)
    arithmetic = np.isclose(2 * centre, low + high, rtol=0.02)
    if not (geometric or arithmetic):
        raise UsageError(
            f"--range {role}: centre {centre:g} is neither the geometric ({np.sqrt(low * high):.4g}) nor the "
            f"arithmetic ({(low + high) / 2:.4g}) middle of {low:g} and {high:g}; correct one of the three."
        )
    return low, centre, high
