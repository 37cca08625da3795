"""The load line of a spindle: current on feed and wear, or feed on wear where the current is held.

Source: Tai, Tsai & Li 2023, IEEE Access, doi 10.1109/ACCESS.2023.3330587, eq. 14 and 15.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..core.errors import FitError
from ..datasets import Runs
from .identifiable import identifiable
from .lawfit import LawFit
from .laws import feed_line, load_line
from .regression import fit_rows
from .rows import Rows, select

Array = NDArray[np.float64]

# A load held by a controller stays within 1 % of its reference (the paper's own regulation): a current that
# moves no more than this is a setting, not a response.
HELD = 0.01


def load_law(runs: Runs, current: str = "I", *, feed: str = "fm", wear: str = "VB") -> LawFit:
    """Fit the load line ``I = A + B fm + k1 VB`` (Tai, Tsai & Li 2023, eq. 14).

    Where most rows stand at one held current, eq. 14 has nothing to fit; eq. 15, feed on wear, is fitted to
    those rows instead and the notes say so. Errors are additive.

    Raises
    ------
    FitError
        A coefficient of the wrong sign (current falls with feed or wear) in rows whose current does vary,
        or too few rows.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("clm2023_end_milling"))
    >>> fit.load_law(runs).form
    'feed_line'
    """
    rows = select(runs, current, [feed, wear], positive="none")
    if not len(rows.y):
        gone = "; ".join(f"{item.count} rows: {item.reason}" for item in rows.dropped)
        raise FitError(f"load line {current} on {feed} and {wear}: no usable row ({gone}). Fill those cells in.")
    held = _held(rows.y)
    if held.all():
        return _held_law(runs, current, feed, wear, rows, held, "the current is held, so it cannot be a response")
    _, left_out = identifiable([feed, wear], rows.X, rows.shifts, logs=False)
    if left_out:
        reasons = "; ".join(f"{item.factor} is {item.reason}" for item in left_out)
        raise FitError(f"load line {current} on {feed} and {wear}: {reasons}. Add runs in which both change.")
    fitted = fit_rows(runs, load_line(current, feed, wear), rows, (), "additive")
    wrong = _wrong_sign(fitted)
    if wrong is None:
        return fitted
    if held.sum() > len(held) / 2:
        return _held_law(runs, current, feed, wear, rows, held, f"eq. 14 is refused: {wrong}")
    raise FitError(f"load line refused: {wrong}. Vary feed at one wear, and wear at one feed, over a wider range.")


def _held(current: Array) -> NDArray[np.bool_]:
    middle = np.median(current)
    return np.asarray(np.abs(current - middle) <= HELD * abs(middle) * (1 + 1e-9), dtype=bool)


def _wrong_sign(fitted: LawFit) -> str | None:
    _, feed, wear = fitted.params
    for name, value, symbol in (("B", feed, fitted.factors[0]), ("k1", wear, fitted.factors[1])):
        if value <= 0:
            unit = f"{fitted.units[fitted.response]}/({fitted.units[symbol]})"
            return (
                f"{name} comes out as {value:.3g} {unit}, but {fitted.response} rises with {symbol} on a "
                f"machine ({fitted.response} ranges over {np.ptp(fitted.observed):.3g} "
                f"{fitted.units[fitted.response]} only)"
            )
    return None


def _held_law(runs: Runs, current: str, feed: str, wear: str, rows: Rows, held: NDArray[np.bool_], why: str) -> LawFit:
    level = float(np.median(rows.y))
    unit = runs.units[current]
    law = feed_line(feed, wear)
    keep, left_out = identifiable([wear], rows.X[held][:, 1:], rows.shifts[held], logs=False)
    if not keep:
        raise FitError(f"{why}; feed on wear (eq. 15) fails too: {wear} is {left_out[0].reason}.")
    at_level = replace(
        rows,
        X=rows.X[held][:, 1:],
        y=rows.X[held][:, 0],
        shifts=rows.shifts[held],
        lines=rows.lines[held],
        edge=None if rows.edge is None else rows.edge[held],
    )
    fitted = fit_rows(runs, law, at_level, (), "additive")
    if fitted.params["slope"] >= 0:
        raise FitError(f"{why}; feed on wear (eq. 15) has the wrong sign too: {feed} does not fall with {wear}.")
    others = len(held) - int(held.sum())
    used = f"the {int(held.sum())} rows held at {level:g} {unit}" + (f" ({others} others not used)" if others else "")
    note = f"{why}; feed is fitted on wear instead (eq. 15), on {used}. It is true at {level:g} {unit} alone."
    return replace(fitted, notes=(*fitted.notes, note))
