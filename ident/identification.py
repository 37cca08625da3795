"""Identification of a record: excited band, delay, order, estimate, and validation by simulation of other samples.

Orders are compared by their simulation error, not by one-step errors, which are optimistic under sensor noise: each is
fitted by SRIV, and Schwarz's criterion of the simulation decides,

    BIC = N_e ln V + 2 p ln N_e,      N_e = N (1 - r) / (1 + r),

V the mean square simulation error over the record, p the number of coefficients, r the lag-one autocorrelation of the
residuals of the best model, N_e the effective sample size. Each coefficient is penalised twice, because the location of
a further pole is selected too. nk = 0 is penalised by 20, because a plant with a zero-order hold responds one sample
later at the earliest; so is each lightly damped pole beyond the excited band, where the record holds no information.

Source: Schwarz 1978, Ann. Stat. 6, 461; Ljung 1999, System Identification, sections 16.4 to 16.6.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pandas as pd

from ..core.arrays import Array
from ..core.display import Plottable
from ..core.errors import IdentError
from ..core.threads import one_thread
from ..core.verdict import DO_NOT_USE, RESERVATIONS, Verdict, verdict_from
from ..datasets.records.record import Record, join_records
from .estimators.bias_checks import causality, feedback_detected, response_error, warn_of_bias
from .estimators.input_checks import check_varies
from .estimators.instrumental import sriv
from .estimators.least_squares import arx
from .estimators.order_selection import OrderSearch, choose_order
from .estimators.prediction_error import armax, output_error
from .model import Model
from .responses.spectra import excited_band
from .validation.handover import Handover, arx_by_choice, judge_handover
from .validation.model_validation import Validation
from .validation.prediction import simulated

MOST_ORDER, MOST_DELAY = 5, 10
FIRST_ORDERS = (2, 4)  # orders for the search of delays; a low order alone mistakes an inverse response for a delay
PENALTY = 20.0  # of BIC, for nk = 0 and for each lightly damped pole beyond the band
RINGING, BEYOND = 0.9, 1.5  # radius of a lightly damped pole; frequency relative to the upper end of the band
EXACT = 1e-18  # of the variance: a loss below it is rounding
SURE = 2.0  # standard errors between the static gain and zero
CHECKED = (
    "Simulation of samples not fitted",
    "Simulation of its own record",
    "Residuals against the input",
    "Poles and settling time",
    "Static gain",
    "Closed loop",
    "Exchanged signals",
)
MOST_SAMPLES = 10_000  # in the search: of longer records the middle part of this length


@dataclass(frozen=True, slots=True, repr=False)
class Identification(Plottable):
    """Identified model of a record with its validation.

    Attributes
    ----------
    record : Record
        The record with its operating point removed.
    model : Model
        Fitted to the whole record, with its excited band: the model that is handed over.
    arx : Model
        Of the same orders by least squares, as in the papers.
    tried : DataFrame
        One row per order and delay: na, nb, nk, loss (mean square simulation error), fit (%), bic.
    one_step : OrderSearch
        Order selection by one-step errors, as in the papers; optimistic under sensor noise.
    judged : Handover
        Validations of the model on its own record, and of its structure on samples that were not fitted.
    bias, feedback, causality : str or None
        Sentences on sensor-noise bias, feedback, and swapped signals, if detected.
    by_choice : str or None
        Clause on an ARX model that was handed over by choice.
    notes : tuple of str
    """

    record: Record
    model: Model
    arx: Model
    tried: pd.DataFrame
    one_step: OrderSearch
    judged: Handover
    bias: str | None
    feedback: str | None
    causality: str | None
    by_choice: str | None = None
    notes: tuple[str, ...] = ()

    @property
    def validation(self) -> Validation:
        """Validation on samples that were not fitted, where the record is long enough."""
        return self.judged.structure

    @property
    def validated_on(self) -> str:
        """Samples of ``validation``, and its model where that is not the one handed over."""
        return self.judged.where

    @property
    def argument(self) -> str:
        """Reason for this order and delay, in two sentences."""
        best = self.tried.iloc[0]
        first = (
            f"na {best.na:.0f}, nb {best.nb:.0f}, nk {best.nk:.0f} has the smallest BIC of {len(self.tried)} orders "
            f"and delays (simulation fit {best.fit:.1f} %)."
        )
        other = self.tried[self.tried["na"] != best.na]
        if other.empty:
            return first
        second = other.iloc[0]
        return (
            f"{first} The best model of another order, na {second.na:.0f}, nb {second.nb:.0f}, nk {second.nk:.0f}, has "
            f"a simulation fit of {second.fit:.1f} % and a BIC larger by {second.bic - best.bic:.0f}."
        )

    @property
    def verdicts(self) -> tuple[str, ...]:
        """Verdict and reservations, worst first."""
        low, high = self.model.band or (0.0, 0.0)
        found = [s for s in (self.by_choice, self.causality, self.feedback, self.bias, self.judged.apart) if s]
        own = () if self.judged.unseen else (f"The model that is handed over {self.judged.own.verdict}.",)
        return (
            f"The model {self.validation.verdict} (validation on {self.validated_on}).",
            *own,
            *map(sentence, found),
            f"Valid in the excited band, {low:.3g} to {high:.3g} Hz.",
            *map(sentence, (*self.judged.own.remarks, *self.model.notes)),
        )

    @property
    def concern(self) -> int:
        """0 none, 1 read the verdicts, 2 do not tune on this model."""
        return self.verdict.level

    @property
    def verdict(self) -> Verdict:
        """How far the model can be used in the excited band, from its validation and from the checks of the record."""
        signs = (self.judged.own.feedback, self.validation.feedback)
        held = [item for item in self.judged.reservations if item[1] not in signs]
        feedback = self.feedback or next(filter(None, signs), None)
        found = [
            *([(DO_NOT_USE, self.causality)] if self.causality else []),
            *_of_gain(self.model),
            *held,
            *([(RESERVATIONS, self.by_choice)] if self.by_choice else []),
            *([(RESERVATIONS, feedback)] if feedback else []),
        ]
        simulation, *checked = CHECKED
        unseen = self.judged.unseen
        done = tuple(checked) if unseen else CHECKED
        left = (f"{simulation}: {unseen.split(',')[0]}",) if unseen else ()
        return verdict_from([(level, sentence(words)) for level, words in found], done, left)


def sentence(clause: str) -> str:
    """The clause with a capital and a full stop.

    >>> sentence("recorded in closed loop")
    'Recorded in closed loop.'
    """
    return f"{clause[0].upper()}{clause[1:].rstrip('.')}."


def _of_gain(model: Model) -> list[tuple[int, str]]:
    """Reservations about the stability and the static gain of a model."""
    if not model.stable:
        radius = float(np.abs(model.poles).max())
        return [(DO_NOT_USE, f"the model is not stable, a pole at radius {radius:.6g}: record it in closed loop")]
    gain, error = model.dc_gain, float(response_error(model, np.zeros(1))[0])
    if abs(gain) >= SURE * error:
        return []
    unit = f" {model.unit_y}/{model.unit_u}" if model.unit_u and model.unit_y else ""
    return [
        (
            DO_NOT_USE,
            f"the static gain, {gain:.3g}{unit}, has a standard error of {error:.2g}, so its sign is not known: record "
            "longer or with more amplitude",
        )
    ]


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
        Candidate delays, samples; by default 0 to 10.
    trend : bool
        Remove a linear trend from each segment, not only its mean.
    handover : {"chosen", "arx"}
        The model that is handed over, ``model``: the one that was chosen, or ARX of the same orders, as in the papers,
        with a reservation.

    Raises
    ------
    IdentError
        The input is constant, the record too short for any order, or no stable model fits it.

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
    whole = (rec if isinstance(rec, Record) else join_records(rec)).centred(trend)
    check_varies(whole)
    notes = tuple(whole.notes)
    band = excited_band(whole)
    tried = _search(_middle(whole), most_order, delays, orders)
    best = tried.iloc[0]
    na, nb, nk = (int(best[name]) for name in ("na", "nb", "nk"))
    feedback = feedback_detected(whole)
    plain, chosen = arx(whole, na, nb, nk), _estimated(whole, na, nb, nk, feedback)
    by_arx = handover == "arx"

    def estimate(part: Record) -> Model:
        return arx(part, na, nb, nk) if by_arx else _estimated(part, na, nb, nk, feedback)

    model = replace(plain if by_arx else chosen, band=band)
    return Identification(
        record=whole,
        model=model,
        arx=replace(plain, band=band),
        tried=tried,
        one_step=choose_order(whole),
        judged=judge_handover(model, whole, estimate, held_out),
        bias=None if feedback else warn_of_bias(plain, chosen, band),
        feedback=feedback,
        causality=causality(whole),
        by_choice=arx_by_choice(plain, chosen, band) if by_arx else None,
        notes=notes,
    )


def _estimated(rec: Record, na: int, nb: int, nk: int, feedback: str | None) -> Model:
    """Output error; in closed loop ARMAX, whose noise model avoids the bias by feedback."""
    if feedback:
        return armax(rec, na, nb, max(na, 1), nk)
    return output_error(rec, nb, na, nk, initial="offset")


def _search(
    rec: Record, most_order: int, delays: Sequence[int] | None, orders: tuple[int, int, int] | None
) -> pd.DataFrame:
    """Simulation errors of the candidate orders and delays."""
    if orders is not None:
        return _compared(rec, [orders])
    near = sorted(set(range(MOST_DELAY + 1) if delays is None else delays))
    looks = [order for order in FIRST_ORDERS if order <= max(most_order, FIRST_ORDERS[0])]
    first = _compared(rec, [(n, n, nk) for n in looks for nk in near])
    candidates = set()
    for n in range(1, most_order + 1):
        order = min((abs(look - n), -look, look) for look in looks)[2]
        candidates |= {(n, nb, k) for nb in (max(n - 1, 1), n) for k in _delays(first, order) if k in near}
    return _compared(rec, sorted(candidates))


def _delays(first: pd.DataFrame, order: int) -> set[int]:
    """Candidate delays: the best of this order, its neighbours, and the longest that is nearly as good."""
    of = first[first["na"] == order]
    of = first if of.empty else of
    best = int(of["nk"].to_numpy()[of["bic"].to_numpy().argmin()])
    longest = int(of.loc[of["bic"] <= of["bic"].min() + np.log(MOST_SAMPLES) / 2, "nk"].max())
    return {best - 1, best, best + 1, longest}


def _compared(rec: Record, candidates: Sequence[tuple[int, int, int]]) -> pd.DataFrame:
    """One row per order that can be fitted; IdentError if there is none."""
    rows, residuals, refusal = [], [], None
    for na, nb, nk in candidates:
        try:
            model = sriv(rec, na, nb, nk, initial="offset")
        except IdentError as error:
            refusal = refusal or error
            continue
        if not model.stable:
            continue
        left = rec.y - simulated(model, rec)
        loss = float(np.mean(left**2))
        rows.append({"na": na, "nb": nb, "nk": nk, "p": na + nb, "loss": loss, "ringing": _ringing(model, rec)})
        residuals.append(left)
    if not rows:
        raise refusal or IdentError(
            "no order gives a stable model of this record: input and output may be swapped, or the plant is not "
            "stable. Record it in closed loop, or remove the trend."
        )
    table = pd.DataFrame(rows)
    size = _effective_size(residuals[int(table["loss"].to_numpy().argmin())])
    spread = float(np.var(rec.y))
    table["bic"] = size * np.log(np.maximum(table["loss"], EXACT * spread)) + 2 * table["p"] * np.log(size)
    table["bic"] += PENALTY * (table["nk"] == 0) + PENALTY * table["ringing"]
    table["fit"] = 100 * (1 - np.sqrt(table["loss"] / spread))
    return table.drop(columns=["p", "ringing"]).sort_values(["bic", "na", "nb"], ignore_index=True)


def _ringing(model: Model, rec: Record) -> int:
    """Number of lightly damped poles beyond the excited band."""
    beyond = 2 * np.pi * BEYOND * excited_band(rec)[1] * model.sample_time
    return int(np.sum((np.abs(model.poles) > RINGING) & (np.abs(np.angle(model.poles)) > beyond)))


def _effective_size(left: Array) -> float:
    """Effective sample size of autocorrelated residuals."""
    power = float(left @ left)
    r = float(left[1:] @ left[:-1]) / power if power > 0 else 0.0
    r = min(max(r, 0.0), 0.99)
    return max(len(left) * (1 - r) / (1 + r), 20.0)


def _middle(rec: Record) -> Record:
    """The middle part of a very long record."""
    if len(rec) <= MOST_SAMPLES:
        return rec
    start = (len(rec) - MOST_SAMPLES) // 2
    return rec.part(start, start + MOST_SAMPLES).centred()
