"""Identification of a record: excited band, structure, estimate, and validation by simulation of other samples.

The structure is chosen by `structure.structure_search`: orders, delays and continuous forms, each with a noise model
of its own, compared by Schwarz's criterion of their innovations. The model is estimated with its noise model and
carries the other structures that the record supports with their weights.

Source: Schwarz 1978, Ann. Stat. 6, 461; Ljung 1999, System Identification, sections 16.4 to 16.6.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np
import pandas as pd

from ..core.arrays import Array
from ..core.display import Plottable
from ..core.errors import IdentError
from ..core.threads import one_thread
from ..core.verdict import DO_NOT_USE, RESERVATIONS, Verdict, verdict_from
from ..datasets.records.gaps import without_short
from ..datasets.records.record import Record, join_records
from ..datasets.records.timing import DELAY_UNCERTAIN
from .closed_loop import Feedback, LoopCheck, check_loop, checked_feedback, feedback
from .estimators.bias_checks import causality, warn_of_bias
from .estimators.input_checks import check_not_proportional, check_varies
from .estimators.least_squares import arx
from .estimators.order_selection import OrderSearch, choose_order
from .model import Model
from .record_disturbances import CHECKED as DISTURBANCES
from .record_disturbances import Disturbances, disturbances
from .responses.spectra import excited_band
from .structure.candidates import Candidate
from .structure.equation_noise import partialled
from .structure.final_estimates import at_amplitude, estimated, mixture
from .structure.fitted_form import FittedForm
from .structure.structure_search import MOST_ORDER, Search, output_before_input, parts_of, search
from .validation.amplitudes import AmplitudeTable
from .validation.handover import Handover, arx_by_choice, judge_handover
from .validation.model_validation import Validation, band_reservations, gain_reservations

LOOP = "Closed loop"
CHECKED = (
    "Simulation of samples not fitted",
    "Simulation of its own record",
    "Residuals against the input",
    "Poles and settling time",
    "Static gain",
    LOOP,
    "Exchanged signals",
)
NONLINEAR = 2  # parameters of a nonlinearity: its size and the change of gain


@dataclass(frozen=True, slots=True, repr=False)
class Identification(Plottable):
    """Identified model of a record with its validation.

    Attributes
    ----------
    record : Record
        The record with its operating point removed and spikes replaced.
    model : Model
        Fitted to the whole record simultaneously with drift and lines, with its excited band: the model that is
        written to the file.
    arx : Model
        Of the same orders by least squares, as in the papers.
    search : Search
        Candidate structures with their criteria and weights.
    one_step : OrderSearch
        Order selection by one-step errors, as in the papers; optimistic under sensor noise.
    judged : Handover
        Validations of the model on its own record, and of its structure on samples that were not fitted.
    loop : LoopCheck
        Whether a controller was active, and the comparison with the two-stage estimate.
    bias, causality : str or None
        Sentences on sensor-noise bias and swapped signals, if detected.
    disturbances : Disturbances
        Spikes, jumps, held readings, missing samples, drift, lines and nonlinearity of the record, each with size and
        place.
    by_choice : str or None
        Clause on an ARX model that is used by choice.
    amplitudes : AmplitudeTable or None
        Gain over amplitude of several runs, where it was asked for.
    notes : tuple of str
    """

    record: Record
    model: Model
    arx: Model
    search: Search
    one_step: OrderSearch
    judged: Handover
    loop: LoopCheck
    bias: str | None
    causality: str | None
    disturbances: Disturbances
    by_choice: str | None = None
    amplitudes: AmplitudeTable | None = None
    notes: tuple[str, ...] = ()

    @property
    def feedback(self) -> str | None:
        """Clause on feedback, if a controller was active."""
        return self.loop.feedback.sentence if self.loop.feedback.found else None

    @property
    def validation(self) -> Validation:
        """Validation on samples that were not fitted, where the record is long enough."""
        return self.judged.structure

    @property
    def validated_on(self) -> str:
        """Samples of ``validation``, and its model where that is not ``model``."""
        return self.judged.where

    @property
    def dead_time(self) -> float:
        """Dead time of the plant, s: of its continuous form, else ``nk`` without the sample that holds the input."""
        form = None if self.by_choice else self.form
        named = {} if form is None else dict(zip(form.symbols, form.values, strict=True))
        if "L" in named:
            return float(named["L"])
        return max(self.model.nk - 1, 0) * self.model.sample_time

    @property
    def tried(self) -> pd.DataFrame:
        """One row per candidate: na, nb, nk, loss (mean square simulation error), fit (%), bic, structure, weight."""
        return self.search.table

    @property
    def chosen(self) -> Candidate:
        """Of ``search``: the structure of ``model``."""
        return self.search.chosen

    @property
    def form(self) -> FittedForm | None:
        """The continuous form, where one was chosen."""
        return self.chosen.form

    @property
    def argument(self) -> str:
        """Reason for this structure, in two sentences."""
        best, found = self.chosen, self.search.candidates
        named, fit = sentence(_named(best))[:-1], f"simulation fit {self.search.fit(best):.1f} %"
        if without := self.search.without:
            count = sum(one.weight > 0 for one in found)
            return (
                f"{named} describes the record best at its amplitude, of {count} structures that the record supports "
                f"once the {without} is removed from the input ({fit} without the {without})."
            )
        behind = best.total - min(one.total for one in found)
        place = "has the smallest criterion (BIC)" if behind <= 0 else "is as good as the smallest criterion (BIC)"
        first = f"{named} {place} of {len(found)} structures"
        if len(self.record) > self.search.n:  # the criteria of the search are of its parts
            parts = f"{self.search.n} of {len(self.record)} samples"
            return f"{first} searched on {parts} and compared on all ({fit})."
        other = [one for one in found if one.na != best.na or (one.form is None) != (best.form is None)]
        if not other:
            return f"{first} ({fit})."
        second = min(other, key=lambda one: one.total)
        apart = second.total - best.total
        by = f"{'larger' if apart >= 0 else 'smaller'} by {abs(apart):.1f}"
        return (
            f"{first} ({fit}). The best of another order or kind, {_named(second)}, has a simulation fit of "
            f"{self.search.fit(second):.1f} % and a criterion {by}."
        )

    @property
    def verdicts(self) -> tuple[str, ...]:
        """Verdict and reservations, worst first."""
        low, high = self.model.band or (0.0, 0.0)
        judged = (self.judged.noise, self.judged.apart)
        found = [s for s in (self.by_choice, self.causality, *self.loop.clauses, self.bias, *judged) if s]
        return (
            self.judged.words,
            *map(sentence, found),
            f"Valid in the excited band, {low:.3g} to {high:.3g} Hz.",
            *(sentence(item.sentence) for item in self.disturbances.found),
            *map(sentence, (*self.judged.own.remarks, *(n for n in self.model.notes if not n.startswith("converged")))),
        )

    @property
    def concern(self) -> int:
        """0 none, 1 read the verdicts, 2 do not tune on this model."""
        return self.verdict.level

    @property
    def verdict(self) -> Verdict:
        """The verdict on the model in the excited band, from its validation and from the checks of the record."""
        signs = (self.judged.own.feedback, self.validation.feedback)
        held = [item for item in self.judged.reservations if item[1] not in signs]
        loop = [] if self.feedback else [(RESERVATIONS, words) for words in filter(None, signs)][:1]
        found = [
            *([(DO_NOT_USE, self.causality)] if self.causality else []),
            *gain_reservations(self.model),
            *band_reservations(self.model),
            *([(self.amplitudes.level, self.amplitudes.sentence)] if self.amplitudes else []),
            *held,
            *self.disturbances.reservations,
            *([(RESERVATIONS, self.by_choice)] if self.by_choice else []),
            *((RESERVATIONS, note) for note in self.notes if note.startswith(DELAY_UNCERTAIN)),
            *self.loop.reservations,
            *loop,
        ]
        undecided = self.loop.feedback.sentence if self.loop.feedback.state == "undecided" else None
        unseen = self.judged.unseen.split(",")[0] if self.judged.unseen else None
        reasons = {CHECKED[0]: unseen, LOOP: undecided, DISTURBANCES: self.disturbances.remark}
        done = tuple(check for check in (*CHECKED, DISTURBANCES) if not reasons.get(check))
        left = tuple(f"{check}: {reason}" for check, reason in reasons.items() if reason)
        return verdict_from([(level, sentence(words)) for level, words in found], done, left)


def _named(one: Candidate) -> str:
    """Name of a continuous form, or orders and delay."""
    orders = f"na {one.na}, nb {one.nb}, nk {one.nk}"
    if one.form is not None:
        return f"the form {one.form.name} ({orders})"
    return f"the structure {orders}{' with equation noise' if one.structure == 'arx' else ''}"


def sentence(clause: str) -> str:
    """The clause with a capital and a full stop.

    >>> sentence("recorded in closed loop")
    'Recorded in closed loop.'
    """
    return f"{clause[0].upper()}{clause[1:].rstrip('.')}."


@one_thread
def identify(
    rec: Record | Sequence[Record],
    *,
    held_out: Record | None = None,
    orders: tuple[int, int, int] | None = None,
    most_order: int = MOST_ORDER,
    delays: Sequence[int] | None = None,
    trend: bool = False,
    handover: Literal["chosen", "arx"] = "chosen",
) -> Identification:
    """Identify a plant from a record of its input and output.

    Parameters
    ----------
    rec : Record or sequence of Record
        One run or several; several are joined, the last is used for validation.
    held_out : Record, optional
        A separate run for validation.
    orders : (na, nb, nk), optional
        Known orders; by default selected.
    most_order : int
        Largest candidate order.
    delays : sequence of int, optional
        Candidate delays, samples; by default 0 to 10, and further while the best lies at the end.
    trend : bool
        Remove a linear trend from each segment, not only its mean.
    handover : {"chosen", "arx"}
        The model that is written to the file, ``model``: the one chosen, or ARX of the same orders, as in the papers,
        with a reservation.

    Raises
    ------
    IdentError
        The input is constant, the record too short for any order, no stable model fits it, or a controller was active
        whose reference did not move.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> t = np.arange(750) * 0.02
    >>> u = 2.5 * np.sin(2 * np.pi * (0.1 + 1.9 / 30 * t) * t)
    >>> y = Model(b=[0.0, 0.1, 0.05], a=[1.0, -1.5, 0.6], nk=1, sample_time=0.02).simulate(u)
    >>> y += 0.01 * np.random.default_rng(1).standard_normal(750)
    >>> found = identify(datasets.Record(u=u, y=y, sample_time=0.02))
    >>> found.model.na, found.model.nk
    (2, 1)
    """
    whole = without_short(rec if isinstance(rec, Record) else join_records(rec)).centred(trend)
    check_varies(whole)
    check_not_proportional(whole)
    band = excited_band(whole)
    disturbed, loop = _cleaned(whole)
    whole = disturbed.record
    linear = None if loop.found or orders else disturbed.linear

    def searched(rec: Record, disturbed: Disturbances) -> Search:
        part = parts_of(rec)
        return search(
            part, most_order=most_order, delays=delays, orders=orders, least_delay=int(loop.found),
            additional=disturbed.columns_of(part), integrators=not disturbed.drift,
        )  # fmt: skip

    found, chosen, disturbed = _structure(searched, whole, linear, disturbed)
    best, additional = found.chosen, disturbed.columns
    one_step = _one_step(whole)
    plain = _plain(partialled(whole, additional), best, one_step)
    by_arx = handover == "arx"

    def estimate(part: Record, additional: Array | None) -> Model:
        if by_arx:
            return arx(partialled(part, additional), plain.na, plain.nb, plain.nk)
        return estimated(part, best, additional)

    discrete = next((one for one in found.candidates if one.form is None), best)
    independent = replace(discrete, structure="box_jenkins")
    model = replace(plain if by_arx else chosen, band=band)
    return Identification(
        record=whole,
        model=model,
        arx=replace(plain, band=band),
        search=found,
        one_step=one_step,
        judged=judge_handover(model, whole, estimate, held_out, additional),
        loop=check_loop(whole, model, band, loop, lambda part: estimated(part, independent, additional)),
        bias=None if loop.found else warn_of_bias(plain, chosen, band),
        causality=_swapped_or_early(whole, found, disturbed, loop),
        disturbances=disturbed,
        by_choice=arx_by_choice(plain, chosen, band) if by_arx else None,
        notes=(*whole.notes, *found.notes),
    )


def _swapped_or_early(rec: Record, found: Search, disturbed: Disturbances, loop: Feedback) -> str | None:
    """Clause on exchanged signals, or on an output before its input; a controller has the effect of both."""
    if loop.found:
        return None
    if (swapped := causality(rec)) or loop.state != "none":
        return swapped
    return output_before_input(rec, found, disturbed.columns_of)


def _cleaned(rec: Record) -> tuple[Disturbances, Feedback]:
    """Disturbances of a record, and the feedback of the record without its spikes."""
    closed = feedback(rec).found
    disturbed = disturbances(rec, closed=closed)
    loop = checked_feedback(disturbed.record)
    return disturbed if loop.found == closed else disturbances(rec, closed=loop.found), loop


def _structure(
    searched: Callable[[Record, Disturbances], Search], rec: Record, linear: Record | None, disturbed: Disturbances
) -> tuple[Search, Model, Disturbances]:
    """The search with the estimate of its chosen structure, and the disturbances that it accounts for.

    The search is that of ``linear``, the record without a nonlinearity of the input, if its criterion is smaller: a
    nonlinearity that is named falsely, or with a wrong size, leaves the structure as it is.
    """
    found, used = _with_drift(partial(searched, rec), disturbed)
    if linear is not None and disturbed.nonlinearity is not None:
        try:
            behind, kept = _with_drift(partial(searched, linear), disturbed)
            if behind.chosen.total + NONLINEAR * np.log(found.n) < found.chosen.total:
                behind = replace(behind, without=disturbed.nonlinearity.kind)
                return *at_amplitude(rec, linear, behind, kept.columns), kept
        except IdentError:  # the input that is left does not identify a model
            pass
    return *mixture(rec, found, used.columns), used


def _with_drift(searched: Callable[[Disturbances], Search], disturbed: Disturbances) -> tuple[Search, Disturbances]:
    """The search with drift, or without it where the plant explains it: a slow plant has responses like a drift."""
    found = searched(disturbed)
    if not disturbed.drift:
        return found, disturbed
    plain = disturbed.without_drift()
    other = searched(plain)
    added = (disturbed.count - plain.count) * np.log(found.n)
    return (other, plain) if other.chosen.total < found.chosen.total + added else (found, disturbed)


def _one_step(rec: Record) -> OrderSearch:
    """Order selection by one-step errors, over the orders that the longest segment allows."""
    longest = max(s.stop - s.start for s in rec.stretches)
    most = max(min(10, longest // 12), 1)
    return choose_order(rec, range(most + 1), range(1, most + 1), range(2 * most + 1))


def _plain(rec: Record, best: Candidate, one_step: OrderSearch) -> Model:
    """ARX of the orders of the candidate; where these are not identifiable, of those that one-step errors select."""
    try:
        return arx(rec, best.na, best.nb, best.nk)
    except IdentError:
        return arx(rec, *one_step.chosen)
