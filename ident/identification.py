"""The whole way from a record to a verdict: band, delay, order, estimate, and a free run on samples not fitted.

Orders are compared by what their free run misses, not by one-step errors, which sensor noise flatters: each is
fitted by SRIV, and Schwarz's criterion of the free run decides,

    BIC = N_e ln V + 2 p ln N_e,      N_e = N (1 - r) / (1 + r),

V the mean square that the free run misses on all of the record, p the number of coefficients, r the lag-one correlation
of what the best model misses: samples that follow each other count for less. Each coefficient counts twice, because a
further pole may sit wherever noise happens to ring: its place is chosen too. nk = 0 counts 20 more, because a machine
behind a hold answers one sample later at the earliest; and so does a pole that rings beyond the excited band, where the
record has nothing to say.

Source: Schwarz 1978, Ann. Stat. 6, 461; Ljung 1999, System Identification, sections 16.4 to 16.6.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ..core.display import Plottable
from ..core.errors import IdentError
from ..core.threads import one_thread
from ..datasets.records.record import Record, join_records
from .estimators.bias_checks import causality, feedback_detected, warn_of_bias
from .estimators.input_checks import check_varies
from .estimators.instrumental import sriv
from .estimators.least_squares import arx
from .estimators.order_selection import OrderSearch, choose_order
from .estimators.prediction_error import armax, output_error
from .model import Model
from .responses.spectra import excited_band
from .validation.model_validation import Validation, validate
from .validation.prediction import simulated

Array = NDArray[np.float64]

MOST_ORDER, MOST_DELAY = 5, 10
FITTED = 2 / 3  # of a single run; the rest judges
FEWEST = 60  # samples of each part: below, the whole record is fitted and judges itself
FIRST_LOOK = (2, 4)  # orders with which delays are looked for; a low order alone takes a wrong-way start for a delay
DOUBT = 20.0  # of BIC: what an answer within the sample, or a ringing pole beyond the band, must be better by
RINGS, BEYOND = 0.9, 1.5  # radius from which a pole rings; times the upper end of the band
EXACT = 1e-18  # of the variance: a loss below it is rounding
MOST_SAMPLES = 10_000  # in the search: of longer records the middle stretch of this length


@dataclass(frozen=True, slots=True, repr=False)
class Identification(Plottable):
    """What a record tells of a machine.

    Attributes
    ----------
    record : Record
        As it was used, less its operating point.
    model : Model
        Handed on: fitted to the whole record, its excited band marked.
    arx : Model
        Of the same orders by least squares, as the papers do it.
    tried : DataFrame
        A row for each order and delay: na, nb, nk, loss (mean square missed in a free run), fit (%), bic, stable.
    one_step : OrderSearch
        The same question asked of one-step errors, from one Gram matrix, as the papers do: sensor noise flatters it.
    validation : Validation
        Of a model of the same orders on samples that it was not fitted to, where the record is long enough.
    validated_on : str
        Which samples these are.
    bias, feedback, causality : str or None
        Sentences where there is something to say.
    notes : tuple of str
    """

    record: Record
    model: Model
    arx: Model
    tried: pd.DataFrame
    one_step: OrderSearch
    validation: Validation
    validated_on: str
    bias: str | None
    feedback: str | None
    causality: str | None
    notes: tuple[str, ...] = ()

    @property
    def argument(self) -> str:
        """Why this order and delay, in two sentences."""
        best = self.tried.iloc[0]
        first = (
            f"na {best.na:.0f}, nb {best.nb:.0f}, nk {best.nk:.0f} has the smallest BIC of {len(self.tried)} orders "
            f"and delays by their free run (fit {best.fit:.1f} %)."
        )
        other = self.tried[self.tried["na"] != best.na]
        if other.empty:
            return first
        second = other.iloc[0]
        return (
            f"{first} The best of another order, na {second.na:.0f}, nb {second.nb:.0f}, nk {second.nk:.0f}, fits "
            f"{second.fit:.1f} % and has a BIC {second.bic - best.bic:.0f} larger."
        )

    @property
    def verdicts(self) -> tuple[str, ...]:
        """What there is to say, worst first."""
        low, high = self.model.band or (0.0, 0.0)
        said = [s for s in (self.causality, self.feedback, self.bias) if s]
        return (
            f"The model {self.validation.verdict} ({self.validated_on}).",
            *(f"{s[0].upper()}{s[1:].rstrip('.')}." for s in said),
            f"Trust it from {low:.3g} to {high:.3g} Hz, where the input had power.",
            *(f"{s[0].upper()}{s[1:].rstrip('.')}." for s in (*self.validation.remarks, *self.model.notes)),
        )

    @property
    def concern(self) -> int:
        """0 none, 1 read the verdicts, 2 do not tune on it."""
        return max(self.validation.concern, int(bool(self.feedback)), 2 * int(bool(self.causality)))


@one_thread
def identify(
    rec: Record | Sequence[Record],
    *,
    held_out: Record | None = None,
    orders: tuple[int, int, int] | None = None,
    most_order: int = MOST_ORDER,
    delays: Sequence[int] | None = None,
    trend: bool = False,
) -> Identification:
    """Identify a machine from a record of its input and output.

    Parameters
    ----------
    rec : Record or sequence of Record
        One run or several; several are joined, and the last judges.
    held_out : Record, optional
        A further run that judges instead.
    orders : (na, nb, nk), optional
        Known; otherwise they are searched for.
    most_order : int
        Largest order tried.
    delays : sequence of int, optional
        Delays tried, samples; 0 to 10 unless given.
    trend : bool
        Take off a straight line from each stretch, not only its mean.

    Raises
    ------
    IdentError
        The input stands still, the record is too short for any order, or no stable model fits it.

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
    fitted, judge, validated_on = _split(whole, held_out)
    trained = _estimated(fitted, na, nb, nk, feedback)
    model = trained if fitted is whole else _estimated(whole, na, nb, nk, feedback)
    plain = arx(whole, na, nb, nk)
    return Identification(
        record=whole,
        model=replace(model, band=band),
        arx=replace(plain, band=band),
        tried=tried,
        one_step=choose_order(whole),
        validation=validate(trained, judge),
        validated_on=validated_on,
        bias=None if feedback else warn_of_bias(plain, model, band),
        feedback=feedback,
        causality=causality(whole),
        notes=notes,
    )


def _estimated(rec: Record, na: int, nb: int, nk: int, feedback: str | None) -> Model:
    """By output error; in a closed loop with a model of the noise, without which feedback biases."""
    if feedback:
        return armax(rec, na, nb, max(na, 1), nk)
    return output_error(rec, nb, na, nk, initial="offset")


def _search(
    rec: Record, most_order: int, delays: Sequence[int] | None, orders: tuple[int, int, int] | None
) -> pd.DataFrame:
    """Free runs of the orders and delays worth a look."""
    if orders is not None:
        return _compared(rec, [orders])
    near = sorted(set(range(MOST_DELAY + 1) if delays is None else delays))
    looks = [order for order in FIRST_LOOK if order <= max(most_order, FIRST_LOOK[0])]
    first = _compared(rec, [(n, n, nk) for n in looks for nk in near])
    asked = set()
    for n in range(1, most_order + 1):
        order = min((abs(look - n), -look, look) for look in looks)[2]
        asked |= {(n, nb, k) for nb in (max(n - 1, 1), n) for k in _delays(first, order) if k in near}
    return _compared(rec, sorted(asked))


def _delays(first: pd.DataFrame, order: int) -> set[int]:
    """The delay whose free run of this order is best, the longest that is nearly as good, and their neighbours."""
    of = first[first["na"] == order]
    of = first if of.empty else of
    best = int(of["nk"].to_numpy()[of["bic"].to_numpy().argmin()])
    longest = int(of.loc[of["bic"] <= of["bic"].min() + np.log(MOST_SAMPLES) / 2, "nk"].max())
    return {best - 1, best, best + 1, longest}


def _compared(rec: Record, asked: Sequence[tuple[int, int, int]]) -> pd.DataFrame:
    """A row for each order that can be fitted; IdentError where none can."""
    rows, missed, refusal = [], [], None
    for na, nb, nk in asked:
        try:
            model = sriv(rec, na, nb, nk, initial="offset")
        except IdentError as error:
            refusal = refusal or error
            continue
        if not model.stable:
            continue
        left = rec.y - simulated(model, rec)
        rows.append(
            {
                "na": na,
                "nb": nb,
                "nk": nk,
                "p": na + nb,
                "loss": float(np.mean(left**2)),
                "ringing": _ringing(model, rec),
            }
        )
        missed.append(left)
    if not rows:
        raise refusal or IdentError(
            "no order gives a stable model of this record: are input and output the right way round, and does the "
            "machine come to rest by itself? Hold it in a loop and record again, or take off the trend."
        )
    table = pd.DataFrame(rows)
    fewer = _independent(missed[int(table["loss"].to_numpy().argmin())])
    spread = float(np.var(rec.y))
    table["bic"] = fewer * np.log(np.maximum(table["loss"], EXACT * spread)) + 2 * table["p"] * np.log(fewer)
    table["bic"] += DOUBT * (table["nk"] == 0) + DOUBT * table["ringing"]
    table["fit"] = 100 * (1 - np.sqrt(table["loss"] / spread))
    return table.drop(columns=["p", "ringing"]).sort_values(["bic", "na", "nb"], ignore_index=True)


def _ringing(model: Model, rec: Record) -> int:
    """Poles that ring beyond the excited band."""
    beyond = 2 * np.pi * BEYOND * excited_band(rec)[1] * model.sample_time
    return int(np.sum((np.abs(model.poles) > RINGS) & (np.abs(np.angle(model.poles)) > beyond)))


def _independent(left: Array) -> float:
    """How many independent samples so many are worth that follow each other."""
    power = float(left @ left)
    r = float(left[1:] @ left[:-1]) / power if power > 0 else 0.0
    r = min(max(r, 0.0), 0.99)
    return max(len(left) * (1 - r) / (1 + r), 20.0)


def _middle(rec: Record) -> Record:
    """Not more of a very long record than a search needs."""
    if len(rec) <= MOST_SAMPLES:
        return rec
    start = (len(rec) - MOST_SAMPLES) // 2
    return rec.part(start, start + MOST_SAMPLES).centred()


def _split(rec: Record, held_out: Record | None) -> tuple[Record, Record, str]:
    """What is fitted, what judges, and that in words."""
    if held_out is not None:
        return rec, held_out, f"the {len(held_out)} samples held out, which it was not fitted to"
    last = rec.starts[-1]
    if len(rec.starts) > 1 and min(last, len(rec) - last) >= FEWEST:
        words = f"run {len(rec.starts)} of {len(rec.starts)}, by a model of the same orders fitted to the others"
        return rec.part(0, last), rec.part(last, len(rec)), words
    cut = int(FITTED * len(rec))
    if len(rec) - cut < FEWEST:
        return rec, rec, "the record is too short to hold samples back: record a second run"
    words = f"samples {cut + 1} to {len(rec)}, by a model of the same orders fitted to those before"
    return rec.part(0, cut).centred(), rec.part(cut, len(rec)), words
