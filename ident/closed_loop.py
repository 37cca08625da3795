"""Closed loop: recognition of feedback, and how far a model from a loop can be trusted.

A controller feeds the noise of the output y into the input u. Then output error and measured frequency responses are
biased; a Box-Jenkins model with autoregressive noise is not, if the loop has a delay (nk of 1 or more) and the noise
model is flexible enough: the noise, not the loop, explains what u and y have in common.

Recognition, Granger's test from y to u: u(t) is regressed on its own past, then also on past and present y. A
generated input is predicted by its own past (a chirp, a constant between two steps), so that y adds nothing; a
controller makes u(t) an exact function of past and present y, past u and a predictable reference. Rows at which the
reference jumps are left out as outliers. Noise recorded on u limits the test: y then helps to predict a generated input
too.

Sources: Soderstrom & Stoica 1989, chapter 10; Ljung 1999, sections 13.4 and 13.5; Granger 1969, doi 10.2307/1912791.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..core.arrays import MAD, Array
from ..core.errors import IdentError
from ..core.threads import one_thread
from ..core.verdict import DO_NOT_USE, RESERVATIONS
from ..datasets.records.record import Record
from .estimators.bias_checks import response_error
from .estimators.filters import squares
from .estimators.reference_response import EXCITE, check_reference, two_stage
from .estimators.regressors import r_of
from .model import Model

PAST = 20  # lags of u and y
FALSE_ALARM = 1e-3  # probability of a false alarm of the F test
MOST_ROWS = 5000  # of longer records the middle
SHARE = 0.8  # of what its own past leaves of u: noise on a generated input reaches .68, a controller .96 and more
OF_PAST = 0.25  # the same by past y alone: a plant without delay reaches .06, a controller .43 and more
DOUBTFUL = 0.3  # share beyond which noise recorded on u and a controller cannot be distinguished
IRREGULAR = 0.2  # of the standard deviation of u, unpredicted: beyond, the response to y would not be visible
OUTLIER = 4.0  # standard deviations (from the MAD) beyond which the reference has jumped
TRIMS = 8
SETTLED = 0.002  # of the rows: fewer that change between two passes do not matter
FREQUENCIES = 40
UNSURE = 0.15  # median standard error of |G| in the band beyond which the loop was not excited
APART, SIGNIFICANT = 0.2, 4.0  # of |G|, and standard errors: a smaller difference of both estimates is no reservation
EXACT = 1e-8  # of the standard deviation: below, u is determined by its own past

REGULATED = 0.85  # of the changes of u: moving references and open loops reach .66, a rounded PI .88
MOST_DELAY, FEWEST = 2, 30  # samples of delay of such a controller, and of the record

State = Literal["found", "none", "undecided"]


@dataclass(frozen=True, slots=True)
class Feedback:
    """Result of the tests of feedback.

    Attributes
    ----------
    state : {"found", "none", "undecided"}
    p : float
        Of Granger's test from the output to the input.
    share : float
        Of the variance that the past of the input leaves, explained by past and present output.
    sentence : str
        The finding as a clause, with what follows from it.
    """

    state: State
    p: float
    share: float
    sentence: str

    @property
    def found(self) -> bool:
        """Whether a controller was active."""
        return self.state == "found"


@one_thread
def feedback(rec: Record) -> Feedback:
    """Whether the input depends on the noise of the output, as under a controller.

    Parameters
    ----------
    rec : Record
        With a ``reference`` the loop was closed: nothing is tested.

    Returns
    -------
    Feedback
        Found where a test at 0.1 % rejects and y explains 80 % of what the past of u leaves. Undecided where y explains
        less, but more than 30 %; where u and y are related within the same sample alone, by a plant without delay or
        by a controller; or where u is so irregular that its response to y would not be visible.

    Notes
    -----
    Not found is a loop whose noise is negligible; it does not bias the model either.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> e, y, u = 0.01 * rng.standard_normal(750), np.zeros(750), np.zeros(750)
    >>> r = np.sin(2e-4 * np.arange(750) ** 2)
    >>> for t in range(1, 750):
    ...     y[t] = 0.8 * y[t - 1] + 0.5 * u[t - 1] + e[t]
    ...     u[t] = 0.3 * (r[t] - y[t])
    >>> feedback(Record(u=u, y=y, sample_time=0.02)).state
    'found'
    >>> feedback(Record(u=r, y=np.convolve(r, [0, 0.5, 0.4])[:750] + e, sample_time=0.02)).state
    'none'
    """
    if rec.reference is not None:
        return Feedback("found", 0.0, 1.0, "the record has the reference of a controller: the loop was closed")
    causes = _granger(rec)
    if causes is None:
        words = f"{len(rec)} samples are too few to test for feedback"
        return Feedback("undecided", 1.0, 0.0, f"{words}: record longer, or state the reference of the controller")
    significant = causes.p < FALSE_ALARM and causes.share > SHARE
    if significant and causes.past > OF_PAST:
        return _found(rec, causes)
    if significant:
        return Feedback("undecided", causes.p, causes.share, _same_sample(rec))
    if causes.p < FALSE_ALARM and causes.share > DOUBTFUL:
        return Feedback("undecided", causes.p, causes.share, _doubtful(rec, causes.share))
    if causes.left > IRREGULAR:
        return Feedback("undecided", causes.p, causes.share, _irregular(rec))
    return Feedback("none", causes.p, causes.share, f"{rec.input} does not depend on {rec.output}: no feedback")


@dataclass(frozen=True, slots=True)
class _Causes:
    """F test of y on u: p, share explained by past and present y, by past y alone, and what the past of u leaves."""

    p: float
    share: float
    past: float
    left: float


def checked_feedback(rec: Record) -> Feedback:
    """Feedback of a record that is to be identified; IdentError where a loop at constant reference was recorded.

    Raises
    ------
    IdentError
        The changes of u follow y as under a PI controller whose reference does not move, or the recorded reference does
        not vary or is the input itself: then the data do not separate the plant from its controller.
    """
    found = feedback(rec)
    if rec.reference is not None:
        check_reference(rec)
    elif found.state != "none" and (law := _constant_reference(rec)) is not None and law[1] > 0:
        share, kp, ki = law
        raise IdentError(
            f"{rec.input} follows {rec.output} as under a PI controller with constant reference (R2 of its changes "
            f"{min(share, 0.9999):.4g}, Kp {kp:.3g}, Ki {ki:.3g} per sample): the data do not separate the plant from "
            f"its controller. {EXCITE}"
        )
    return found


def _constant_reference(rec: Record) -> tuple[float, float, float] | None:
    """R2, Kp and Ki (per sample) of u(t) - u(t - 1) = - Kp (y(t) - y(t - 1)) - Ki y(t), if it is nearly exact.

    It explains as much of what the two changes before leave: a slow command resembles the output of a drive that
    follows it, but is known from its own past.
    """
    change = np.concatenate([np.diff(rec.u[s])[2:] for s in rec.stretches])
    power = squares(change)
    if len(change) < FEWEST or power <= EXACT**2 * squares(rec.u):
        return None
    own = np.column_stack([np.concatenate([np.diff(rec.u[s])[2 - k : -k] for s in rec.stretches]) for k in (1, 2)])
    alone = _left(own, change)
    best, rest = (0.0, 0.0, 0.0), 1.0
    for delay in range(MOST_DELAY + 1):
        parts = [(rec.y[s] - rec.y[s].mean()) for s in rec.stretches]
        now, before = (
            np.concatenate([y[3 - lag : len(y) - lag] for y in parts if len(y) > 3]) for lag in (delay, delay + 1)
        )
        columns = np.column_stack([now, before])
        theta = np.linalg.lstsq(columns, change, rcond=None)[0]
        share = 1 - squares(change - columns @ theta) / power
        if share > best[0]:
            best = (share, float(theta[1]), -float(theta.sum()))
            rest = _left(np.column_stack([own, columns]), change) / max(alone, 1e-300)
    return best if best[0] > REGULATED and 1 - rest > REGULATED else None


def _left(columns: Array, y: Array) -> float:
    """Sum of squares of y that columns do not explain."""
    return squares(y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0])


def _found(rec: Record, causes: _Causes) -> Feedback:
    return Feedback(
        "found",
        causes.p,
        causes.share,
        f"the input depends on the output, as in closed loop: {rec.output} explains {_percent(causes.share)} of what "
        f"the past of {rec.input} leaves open (p {max(causes.p, 1e-99):.1g}). The model is estimated with its noise "
        "and with a delay of at least one sample; output error and measured frequency responses are biased. To confirm "
        f"it, read the reference of the controller too (--reference), or excite {rec.input} in open loop; where no "
        "controller was active, the columns may be exchanged (--input, --output), or recorded with different clocks",
    )


def _same_sample(rec: Record) -> str:
    return (
        f"{rec.input} and {rec.output} are related within the same sample, by a plant without delay or by a "
        "controller: feedback cannot be decided. If a controller was active, state its reference (--reference); "
        f"if not, check whether {rec.input} is recorded one sample late"
    )


def _doubtful(rec: Record, share: float) -> str:
    return (
        f"{rec.output} explains {_percent(share)} of what the past of {rec.input} leaves open, as under a controller "
        f"or with noise recorded on {rec.input}: feedback cannot be decided. If a controller was active, state its "
        f"reference (--reference); if not, record the commanded {rec.input} instead of a measured one"
    )


def _irregular(rec: Record) -> str:
    return (
        f"{rec.input} is too irregular for a response to {rec.output} to be visible: feedback cannot be decided. "
        "If a controller was active, state its reference (--reference), or record a chirp or steps as reference"
    )


def _percent(share: float) -> str:
    """A share as text, never rounded up to 100 %.

    >>> _percent(0.99996), _percent(0.873)
    ('more than 99.9 %', '87 %')
    """
    return "more than 99.9 %" if share > 0.999 else f"{100 * min(share, 0.99):.0f} %"


def _granger(rec: Record) -> _Causes | None:
    """Granger's test from y to u, without the rows at which u jumps; None for too short a record."""
    from scipy.stats import f as f_distribution

    rows = _rows(rec)
    if rows is None:
        return None
    past = (rows.shape[1] - 3) // 2
    kept, r = np.ones(len(rows), dtype=bool), r_of(rows)
    for _ in range(TRIMS):
        e = np.abs(rows @ np.append(-_solution(r), 1.0))
        near = e <= OUTLIER * MAD * float(np.median(e[kept]))
        if np.mean(near != kept) <= SETTLED or near.sum() < 2 * rows.shape[1]:
            break
        kept, r = near, r_of(rows[near])
    # u(t) is the last column: its squares beyond the constant and past u, past y, present y
    squares = r[:, -1] ** 2
    left, without, within = (float(squares[k:].sum()) for k in (past + 1, 2 * past + 1, 2 * past + 2))
    total, n = float(np.var(rec.u)) * int(kept.sum()), int(kept.sum())
    if left <= EXACT**2 * total:
        return _Causes(1.0, 0.0, 0.0, 0.0)
    free = n - rows.shape[1] + 1
    statistic = (left - within) / (past + 1) / max(within / free, 1e-300)
    p = float(f_distribution.sf(statistic, past + 1, free))
    return _Causes(p, 1 - within / left, 1 - without / left, float(np.sqrt(left / total)))


def _solution(r: Array) -> Array:
    """Coefficients of the last column of a triangle by the others; a ridge at rounding covers collinear columns."""
    g = r[:, :-1].T @ r
    g[np.diag_indices(len(g))] *= 1 + 1e-13
    g[np.diag_indices(len(g))] += np.finfo(float).tiny
    return np.asarray(np.linalg.solve(g[:, :-1], g[:, -1]))


def _rows(rec: Record) -> Array | None:
    """Rows 1, u(t - 1) ..., y(t - 1) ..., y(t), u(t); None where there are fewer than 2 per column."""
    past = min(PAST, len(rec) // 12)
    t = np.concatenate([np.arange(min(s.start + past, s.stop), s.stop) for s in rec.stretches])
    if past < 2 or len(t) < 2 * (2 * past + 3):
        return None
    t = t[max((len(t) - MOST_ROWS) // 2, 0) :][:MOST_ROWS]
    rec = rec.centred()
    lags = t[:, None] - np.arange(1, past + 1)
    return np.column_stack([np.ones(len(t)), rec.u[lags], rec.y[lags], rec.y[t], rec.u[t]])


@dataclass(frozen=True, slots=True)
class LoopCheck:
    """The checks of a model from a closed loop.

    Attributes
    ----------
    feedback : Feedback
    two_stage : Model or None
        The comparison, where the reference was recorded.
    difference : float
        Largest difference of both, as a share of |G|, at frequencies of the band; 0 without a comparison.
    reservations : tuple of (int, str)
    sentence : str
        Comparison as a sentence, empty without one.
    """

    feedback: Feedback
    two_stage: Model | None = None
    difference: float = 0.0
    reservations: tuple[tuple[int, str], ...] = ()
    sentence: str = ""

    @property
    def clauses(self) -> tuple[str, ...]:
        """The finding, unless no feedback was found, and the comparison."""
        found = () if self.feedback.state == "none" else (self.feedback.sentence,)
        return (*found, *filter(None, (self.sentence,)))


def check_loop(
    rec: Record, model: Model, band: tuple[float, float], found: Feedback, estimate: Callable[[Record], Model]
) -> LoopCheck:
    """Reservations of a model from a record that may be of a closed loop, and its comparison with two-stage.

    Parameters
    ----------
    rec : Record
        Centred.
    model : Model
        The direct estimate.
    band : tuple of float
        Excited band, Hz.
    found : Feedback
        Of ``feedback(rec)``.
    estimate : callable
        Estimates a discrete model, with noise independent of its poles, from any record.
    """
    if not found.found:
        return LoopCheck(found, reservations=_inverse_of_controller(model, found))
    f = np.geomspace(*band, FREQUENCIES)
    size, error = np.abs(model.response(f)), response_error(model, f)
    unsure = float(np.median(error / size))
    doubts: list[tuple[int, str]] = []
    if not unsure < UNSURE:
        doubts.append((DO_NOT_USE, _not_excited(unsure)))
    if rec.reference is None:
        return LoopCheck(found, reservations=(*doubts, (RESERVATIONS, found.sentence)))
    try:
        other = two_stage(rec, estimate)
    except IdentError as refusal:
        return LoopCheck(found, reservations=(*doubts, (RESERVATIONS, f"no two-stage comparison: {refusal}")))
    distance = np.abs(other.response(f) - model.response(f))
    both = np.hypot(error, response_error(other, f))
    k = int(np.argmax(distance / size))
    largest = float(distance[k] / size[k])
    words = (
        f"the two-stage estimate from the reference differs from the direct one by at most {_percentage(largest)} of "
        f"|G| in the excited band (at {f[k]:.3g} Hz, standard error {_percentage(float(both[k] / size[k]))})"
    )
    if ((distance > APART * size) & (distance > SIGNIFICANT * both)).any():
        words += (
            "; it is the less accurate of both, above all where the reference moves seldom, but a large difference can "
            "also mean a controller that was limited or switched"
        )
    return LoopCheck(found, other, largest, tuple(doubts), words)


def _inverse_of_controller(model: Model, found: Feedback) -> tuple[tuple[int, str], ...]:
    """Reservation about a response within the same sample against the static gain, where feedback is not decided."""
    first, gain = float(model.b[0]), model.dc_gain
    if found.state == "none" or model.nk > 0 or not first * gain < 0:
        return ()
    if model.cov_params is not None:
        error = float(np.sqrt(model.cov_params[model.na, model.na]))
        if abs(first) <= SIGNIFICANT * error:
            return ()
    words = (
        f"{model.output} answers {model.input} within the same sample and against the static gain (b0 {first:.3g}, "
        f"static gain {gain:.3g}), and feedback cannot be decided: this is minus the inverse of a controller rather "
        "than a plant. State the reference of the controller (--reference), or record in open loop"
    )
    return ((DO_NOT_USE, words),)


def _percentage(share: float) -> str:
    """A share in %, two figures below 10 %.

    >>> _percentage(0.0123), _percentage(4.7)
    ('1.2 %', '470 %')
    """
    return f"{100 * share:.2g} %" if share < 0.1 else f"{100 * share:.0f} %"


def _not_excited(unsure: float) -> str:
    """Clause on a loop whose data do not determine the plant."""
    return (
        f"the loop was not excited enough: the median standard error of |G| in the band is {100 * unsure:.0f} %, so "
        f"the plant is not separated from its controller. {EXCITE}"
    )
