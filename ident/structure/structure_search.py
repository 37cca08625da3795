"""Search of the structure of a record: all candidates with their criteria and weights, and the limits reached.

    y = b/a u + 1/d e      or, with equation noise,      a y = b u + e

Orders na are 1 to 5, nb 1 to na + 1 and more where the criterion asks for it, delays whole samples, extended while the
best lies at the end. Each candidate has a noise model of its own; `choice` holds criterion, penalty and weights.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from ...core.arrays import Array
from ...core.errors import IdentError
from ...datasets.records.record import Record
from ..estimators.plant_and_noise import box_jenkins
from ..responses.spectra import excited_band
from .candidates import (
    HOPELESS,
    Candidate,
    Screen,
    equation,
    fitted,
    form_candidates,
    integrating_candidates,
    no_model,
    refined,
    scanned,
    screen_of,
)
from .choice import weights
from .equation_noise import equation_candidates

MOST_ORDER, MOST_DELAY = 5, 10
FARTHEST = 87  # samples of delay, or a tenth of the longest segment: a file holds 100 coefficients
AHEAD = 3  # delays scanned beyond the best
MIDDLE = 3  # order that is tried first: the others are compared with it
CLOSE = 10.0  # of the criterion above the best: candidates whose neighbours are fitted
REFINED = 8  # candidates whose plant and noise model are fitted jointly
EQUAL = 2.0  # of the criterion: no evidence (Kass & Raftery 1995, doi 10.1080/01621459.1995.10476572)
MOST_SAMPLES, PARTS = 3200, 8  # of longer records so many parts with so many samples together are searched
EARLY = 8  # samples by which an output is tried before its input
DIFFERENCES, POOR = 5.0, 80.0  # sum of |b| over |b(1)|, and fit in %: a model that only differentiates, or fits badly
BEYOND_DOUBT = 50.0  # of the criterion: a simpler model of an early output is better by more
AS_GOOD = 6.0  # of the criterion: weights differ by a factor of 4


@dataclass(frozen=True, slots=True)
class Search:
    """Candidates of a record, the chosen one first.

    Attributes
    ----------
    candidates : tuple of Candidate
        Sorted by criterion and penalty, the chosen one first.
    n : int
        Samples searched.
    spread : float
        Variance of the output.
    notes : tuple of str
        Limits of the search that the chosen candidate reaches.
    without : str
        Kind of nonlinearity whose effect was removed from the input before the search, or empty.
    """

    candidates: tuple[Candidate, ...]
    n: int
    spread: float
    notes: tuple[str, ...] = ()
    without: str = ""

    @property
    def chosen(self) -> Candidate:
        """The first candidate, by default the one with the smallest criterion and penalty, or a form as good."""
        return self.candidates[0]

    def estimated(self, models: Sequence[Candidate]) -> "Search":
        """The same with candidates that were estimated anew, the first as the chosen one; the others without weight."""
        chosen, *rest = models
        known = {one.name for one in models}
        rest += [replace(one, weight=0.0) for one in self.candidates if one.name not in known]
        return replace(self, candidates=(chosen, *sorted(rest, key=lambda one: one.total)))

    def fit(self, one: Candidate) -> float:
        """Simulation fit of a candidate, %."""
        return float(100 * (1 - np.sqrt(one.loss / self.spread)))

    @property
    def table(self) -> pd.DataFrame:
        """One row per candidate; ``bic`` is criterion and penalty."""
        rows = [
            {
                "na": one.na, "nb": one.nb, "nk": one.nk, "loss": one.loss, "fit": self.fit(one), "bic": one.total,
                "structure": one.structure, "form": one.form.name if one.form else "", "noise": len(one.d) - 1,
                "variance": one.variance, "guard": one.guard, "weight": one.weight,
                "integrating": one.integrating,
            }
            for one in self.candidates
        ]  # fmt: skip
        return pd.DataFrame(rows)


def search(
    rec: Record,
    *,
    most_order: int = MOST_ORDER,
    delays: Sequence[int] | None = None,
    orders: tuple[int, int, int] | None = None,
    least_delay: int = 0,
    additional: Array | None = None,
    integrators: bool = True,
) -> Search:
    """Candidates of a record.

    Parameters
    ----------
    rec : Record
        Centred.
    most_order : int
        Largest na.
    delays : sequence of int, optional
        Candidate delays, samples; by default 0 to 10 and further while the best lies at the end.
    orders : (na, nb, nk), optional
        The only structure, with either noise model.
    least_delay : int
        1 for a record in closed loop, where a direct response cannot be separated from the feedback.
    additional : ndarray, shape (N, k), optional
        Additional regressors of the output: lines, drift; estimated simultaneously with the plant.
    integrators : bool
        Whether a pole may lie at exactly 1; not where the regressors describe a drift, which such a pole fits too.

    Raises
    ------
    IdentError
        No candidate is stable, or the record is too short for any.
    """
    band = excited_band(rec)
    if orders is not None:
        return _result(rec, _given(rec, band, orders, additional), ())
    longest = max(s.stop - s.start for s in rec.stretches)
    reach = Reach.of(delays, least_delay, min(FARTHEST, longest // 10))
    screen = screen_of(rec, band, least_delay, 0 if reach.open else reach.delays[-1], additional)
    forms = [one for one in form_candidates(screen, reach.delays) if reach.holds(one.nk)]
    long = min(forms, key=lambda one: one.total).nk if forms and reach.open else 0
    if long > MOST_DELAY:
        screen, reach = screen_of(rec, band, least_delay, long, additional), replace(reach, long=long)
    tried = range(1, min(most_order, max(longest // 20, 1)) + 1)
    found: list[Candidate] = []
    for na in sorted(tried, key=lambda na: abs(na - MIDDLE)):
        found += _of_order(screen, na, reach, _least(found))
    last = max((one.nk for one in found), default=0)
    found += equation_candidates(screen, len(tried), reach.upto(last + AHEAD))
    found += forms
    found = [one for one in found if integrators or not one.integrating] or found
    if not found:
        raise no_model()
    found = _with_neighbours(screen, sorted(found, key=lambda one: one.total), reach)
    found = [refined(screen, one) for one in found[:REFINED]] + found[REFINED:]
    found = sorted(found, key=lambda one: one.total)
    slow = integrating_candidates(screen, found) if integrators else []
    found = _without_doubles(sorted(found + slow, key=lambda one: one.total))
    return _result(rec, _form_first(found), _limits(found, most_order, reach))


def _form_first(found: list[Candidate]) -> list[Candidate]:
    """Sorted candidates, a continuous form first if the criterion does not separate it from the best: it has units."""
    best = next((one for one in found if one.form is not None and one.total < found[0].total + EQUAL), found[0])
    return [best, *(one for one in found if one is not best)]


def _without_doubles(found: Sequence[Candidate]) -> list[Candidate]:
    """Sorted candidates without those of which a better one has the slow pole at exactly 1: their gain is not known."""
    better: set[tuple[str, int, int, int]] = set()
    out = []
    for one in found:
        key = (one.structure, one.na, one.nb, one.nk)
        if one.integrating and one.form is None:
            better.add(key)
        elif one.form is None and key in better:
            continue
        out.append(one)
    return out


@dataclass(frozen=True, slots=True)
class Reach:
    """Delays that may be tried, whether they were left to the search, and the delay of the best form if it is long."""

    delays: tuple[int, ...]
    open: bool
    long: int = 0

    @classmethod
    def of(cls, delays: Sequence[int] | None, least: int, farthest: int) -> "Reach":
        """The delays asked for, or all from ``least`` to ``farthest``."""
        if delays is None:
            return cls(tuple(range(least, max(farthest, least) + 1)), True)
        return cls(tuple(sorted({max(int(k), least) for k in delays})), False)

    def holds(self, nk: int) -> bool:
        """Whether a form may have this delay: it is estimated, and need not be one of those that are scanned."""
        return nk <= self.delays[-1] + 1 if self.open else nk in self.delays

    def upto(self, last: int) -> list[int]:
        """The delays asked for, or those up to ``last`` and at least the usual number."""
        return [k for k in self.delays if k <= max(last, MOST_DELAY)] if self.open else list(self.delays)


def _best_delay(screen: Screen, na: int, reach: Reach) -> tuple[int, Array]:
    """Best delay of an order with na coefficients of b; its f.

    Every second delay is scanned, further while the best lies at the end, and those about the delay of a form if that
    is long; then the neighbours of the best.
    """
    coarse = reach.delays[:: 2 if reach.open else 1]
    found = scanned(screen, na, na, [k for k in coarse if k <= MOST_DELAY or not reach.open])
    if reach.long:
        found |= scanned(screen, na, na, [k for k in coarse if abs(k - reach.long) <= AHEAD])
    while found:
        best, end = min(found, key=lambda nk: found[nk][0]), max(found)
        more = [k for k in coarse if end < k <= end + MOST_DELAY] if best > end - AHEAD else []
        if not more:
            break
        found |= scanned(screen, na, na, more)
    if not found:
        return reach.delays[0], np.ones(1)
    best = min(found, key=lambda nk: found[nk][0])
    f = np.concatenate([np.ones(1), found[best][1][:na]])
    near = [k for k in (best - 1, best + 1) if k in reach.delays and k not in found]
    found |= scanned(screen, na, na, near, f)
    best = min(found, key=lambda nk: found[nk][0])
    return best, np.concatenate([np.ones(1), found[best][1][:na]])


def _of_order(screen: Screen, na: int, reach: Reach, others: float) -> list[Candidate]:
    """Candidates of one na: nb from 1 to na + 1, and further while the criterion falls; fewer if all are far behind.

    ``others`` is the smallest criterion of the other orders.
    """
    best, f = _best_delay(screen, na, reach)

    def at(nb: int, least: float) -> list[Candidate]:
        around = {best - 1, best, best + 1, best + na - nb, best + na - nb + 1, best + na - nb - 1}
        if best > 0 and nb <= na:
            around.discard(0)  # the direct response is one coefficient of the widest b more
        tried = [(*equation(screen, (na, nb, k), f, 1), k) for k in sorted(around) if k in reach.delays]
        if not tried:
            return []
        theta, _, k = min(tried, key=lambda t: t[1])
        one = fitted(screen, (na, nb, k), theta, least)
        return [] if one is None else [one]

    widest = out = at(na + 1, others)
    if _least(out) > others + HOPELESS + na * np.log(len(screen.rec)):
        return out
    for nb in range(na, 0, -1):
        lowest = min(_least(out), others)
        fewer = at(nb, lowest)
        out = out + fewer
        if min((one.criterion for one in fewer), default=np.inf) > lowest + HOPELESS + nb * np.log(len(screen.rec)):
            break  # fewer coefficients of b fit no better
    for nb in range(na + 2, 2 * na + 3):
        if _least(widest) > _least(out):
            break
        widest = at(nb, min(_least(out), others))
        out = out + widest
    return out


def _with_neighbours(screen: Screen, found: list[Candidate], reach: Reach) -> list[Candidate]:
    """Sorted candidates with the neighbours of the good ones: one sample of delay, or one coefficient of b less.

    The neighbours of a neighbour that is better follow. The delays of an order are compared by an iteration that may
    not have converged, so the best one need not be among the candidates before.
    """
    own = [one for one in found if one.form is None and one.structure == "box_jenkins"]
    known = {(one.na, one.nb, one.nk) for one in own}
    good = (one for one in reversed(own) if one.total < found[0].total + CLOSE)
    waiting = list({(one.na, one.nb): one for one in good}.values())  # the best delay of each pair of orders
    out = list(found)
    while waiting:
        one = waiting.pop()
        for orders, theta in _neighbours_of(one):
            if orders not in known and orders[2] in reach.delays:
                known.add(orders)
                other = fitted(screen, orders, theta, found[0].total)
                out += [other] if other else []
                waiting += [other] if other and other.total < one.total else []
    return sorted(out, key=lambda one: one.total)


def _neighbours_of(one: Candidate) -> list[tuple[tuple[int, int, int], Array]]:
    """Orders of the neighbours of a candidate with a starting value."""
    na, nb, nk, theta = one.na, one.nb, one.nk, one.theta
    found = [((na, nb, nk - 1), theta), ((na, nb, nk + 1), theta)]
    if nb > 1:
        found += [((na, nb - 1, nk), theta[:-1]), ((na, nb - 1, nk + 1), np.delete(theta, na))]
    return found


def _least(found: Sequence[Candidate]) -> float:
    """Smallest criterion with its penalty; infinite without a candidate."""
    return min((one.total for one in found), default=np.inf)


def output_before_input(rec: Record, found: Search, columns_of: Callable[[Record], Array | None]) -> str | None:
    """Clause if the output responds to the input before it changes, otherwise None.

    A model of a smooth input predicts it: many coefficients of alternating sign. Then, or where the fit is poor, models
    of an output that is delayed by EARLY samples are searched; a simpler and far better one responds too early.
    ``columns_of`` gives additional regressors of a record, or None.
    """
    best = found.chosen
    differences = float(np.abs(best.b).sum()) > DIFFERENCES * abs(float(best.b.sum()))
    if found.without or best.integrating or not (differences or found.fit(best) < POOR):
        return None
    long = [s for s in rec.stretches if s.stop - s.start > 10 * EARLY]
    if not long:
        return None
    u = np.concatenate([rec.u[s.start + EARLY : s.stop] for s in long])
    y = np.concatenate([rec.y[s.start : s.stop - EARLY] for s in long])
    starts = tuple(int(k) for k in np.cumsum([0, *(s.stop - s.start - EARLY for s in long[:-1])]))
    part = parts_of(Record(u=u, y=y, sample_time=rec.sample_time, starts=starts).centred())
    try:
        other = search(part, most_order=2, delays=range(EARLY), additional=columns_of(part))
    except IdentError:
        return None
    early = other.chosen
    better = found.chosen.total / found.n - early.total / other.n
    if better * other.n < BEYOND_DOUBT or early.na + early.nb > best.na + best.nb:
        return None
    samples = EARLY - early.nk
    return (
        f"{rec.output} responds at least {samples} sample{'s' * (samples > 1)} ({samples * rec.sample_time:.3g} s) "
        f"before {rec.input} changes: the two were recorded with different clocks, or {rec.input} was logged late. "
        "Record both with one clock, or shift one of the columns"
    )


def parts_of(rec: Record) -> Record:
    """Evenly spaced parts of one length of a very long record: of a sweep, each excites another frequency."""
    if len(rec) <= MOST_SAMPLES:
        return rec
    size = MOST_SAMPLES // PARTS
    long = [s for s in rec.stretches if s.stop - s.start >= size]
    if not long:
        return rec.part(0, MOST_SAMPLES).centred()
    # each segment holds parts in proportion to its length
    first = np.concatenate([np.arange(s.start, s.stop - size + 1) for s in long])
    starts = first[np.linspace(0, len(first) - 1, PARTS).astype(np.intp)]
    starts = starts[np.r_[True, np.diff(starts) >= size]]
    rows = (starts[:, None] + np.arange(size)).ravel()
    offsets = np.asarray(rec.offsets)[np.searchsorted(rec.starts, starts, side="right") - 1]
    joined = tuple(int(k) * size for k in range(len(starts)))
    return replace(
        rec, u=rec.u[rows], y=rec.y[rows], starts=joined, offsets=offsets, sha256=None, reference=None
    ).centred()


def _given(
    rec: Record, band: tuple[float, float], orders: tuple[int, int, int], additional: Array | None
) -> list[Candidate]:
    """The given structure, its noise model chosen."""
    na, nb, nk = orders
    screen = screen_of(rec, band, min(nk, 1), nk, additional)
    start = box_jenkins(rec, nb, na, 0, nk, additional=additional)
    one = fitted(screen, orders, start.theta)
    if one is None or not np.isfinite(one.criterion):
        raise no_model()
    return [refined(screen, one)]


def _result(rec: Record, found: Sequence[Candidate], notes: tuple[str, ...]) -> Search:
    """Candidates with their weights."""
    shares = weights([one.total for one in found], [one.nk == 0 for one in found])
    ranked = tuple(replace(one, weight=float(w)) for one, w in zip(found, shares, strict=True))
    return Search(ranked, len(rec), float(np.var(rec.y)), notes)


def _limits(found: Sequence[Candidate], most_order: int, reach: Reach) -> tuple[str, ...]:
    """Notes on limits that the best candidate reaches, or for the delay one that is about as good."""
    best, notes, last = found[0], [], reach.delays[-1]
    if best.na == most_order and best.form is None:
        notes.append(
            f"na {best.na} is the largest order tried: the plant may have a higher one (--orders; Python: most_order)"
        )
    near = [one for one in found if one.total < best.total + AS_GOOD]
    if any(one.nk == last for one in near) and len(reach.delays) > 1:
        notes.append(
            f"nk {last} is the longest delay tried: the plant may have a longer one. Resample to a lower rate "
            "(--resample), or give --orders (Python: delays)"
        )
    return tuple(notes)
