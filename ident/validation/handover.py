"""Validation of the model that is written to the file, and of its structure on samples that were not fitted.

The model is estimated from all samples, so no sample is left to validate it. Two validations together judge it:

    structure    the same structure, estimated from four of six blocks of the record, simulates the second and the fifth
    own          the model itself simulates its own record; its residuals, poles and settling time are those judged

Blocks, because the last third of a sweep has other frequencies than the rest, and little output: the true structures of
a bank of plants explained 5 to 98 % of it where they explain 70 to 99 % of such blocks (white noise of 30 dB). Where
both models differ in the excited band by more than their standard errors allow, the structure does not describe the
plant, or the plant changed. A record held out on purpose validates the model itself.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...core.arrays import Array
from ...core.errors import IdentError
from ...core.verdict import RESERVATIONS
from ...datasets.records.record import Record, join_records
from ..estimators.bias_checks import FREQUENCIES, response_error
from ..model import Model
from ..responses.spectra import excited_band
from .model_validation import DEPEND, FIT, GOOD, Validation, states_of, validate

FEWEST = 60  # samples of each block: below, the whole record is fitted and validated
BLOCK = 100  # samples of a block from which on there are six
LARGER = 1.3  # rms error on samples that were not fitted, relative to the own record: below, the noise is the reason
APART = 0.1  # of |G|: a smaller difference of the two models does not matter
SIGNIFICANT = 4.0  # standard errors of that difference
SAME_BAND = 0.7  # of the excited band, in each of two runs
Span = tuple[int, int]
Estimate = Callable[[Record, Array | None], Model]  # of the same structure, from any record and additional regressors
LITTLE = 0.05  # of the change of the input: samples with less do not validate a model
UNCHANGED = (
    "the input hardly changes in the samples that can be held out, or in the others, so the model was validated "
    "on those that it was fitted to: record a second run in which the input changes"
)
TOO_SHORT = "the estimation record, too short to hold out samples: record a second run"
OWN_RECORD = (
    "the record is too short to hold out samples, so the model was validated on those that it was fitted to: record a "
    "second run"
)


@dataclass(frozen=True, slots=True)
class Handover:
    """Validations of the model that is written to the file.

    Attributes
    ----------
    structure : Validation
        On samples that were not fitted, of the same structure fitted to the others; of the model itself on a record
        that was held out; where neither can be had, ``own``.
    own : Validation
        Of the model on the record that it was fitted to.
    where : str
        Samples and model of ``structure``.
    apart : str or None
        Clause on the difference between the model and that of ``structure``, if it is significant.
    unseen : str or None
        Reason why no samples were held out.
    """

    structure: Validation
    own: Validation
    where: str
    apart: str | None = None
    unseen: str | None = None

    @property
    def words(self) -> str:
        """Sentence on both simulations and on the residuals."""
        if self.unseen:
            return f"The model {self.own.verdict} ({self.where})."
        both = (*self.structure.reservations, *self.own.reservations)
        depend = next((words.split(":")[0] for _, words in both if words.startswith(DEPEND)), None)
        return (
            f"The model simulates samples that were not fitted with {self.structure.fit:.0f} % fit ({self.where}), its "
            f"own record with {self.own.fit:.0f} %; {depend or 'residuals are independent of the input'}."
        )

    @property
    def reservations(self) -> tuple[tuple[int, str], ...]:
        """Reservations with their level; each clause states which model and samples its figure is of."""
        if self.unseen:
            return (*self.own.reservations, (RESERVATIONS, self.unseen))
        own = [(level, f"{words} (model on its own record)") for level, words in self.own.fit_reservations]
        other = [
            (level, f"{words} ({self.where})")
            for level, words in self.structure.fit_reservations
            if not (_repeated(words, own) or (self.noise and words.startswith(FIT)))
        ]
        kept = [item for item in self.own.reservations if item not in self.own.fit_reservations]
        apart = [(RESERVATIONS, self.apart)] if self.apart else []
        return (*other, *own, *kept, *apart)

    @property
    def noise(self) -> str:
        """Clause where noise and not the structure limits the fit to the samples that were not fitted, else empty.

        Its errors are then no larger than those of the model on its own record, whose output varies more.
        """
        here, there = (float(np.sqrt(np.mean((v.y - v.yhat) ** 2))) for v in (self.structure, self.own))
        if self.unseen or self.structure.fit >= GOOD or here > LARGER * there:
            return ""
        return (
            f"the fit on {self.where.split(',')[0]} is limited by the noise: the rms error is {here:.3g}, on the own "
            f"record {there:.3g}"
        )


def _repeated(words: str, own: list[tuple[int, str]]) -> bool:
    """Whether a clause that is no figure of the fit stands among those of the own record."""
    return words.startswith(DEPEND) and any(text.startswith(DEPEND) for _, text in own)


def judge_handover(
    model: Model, whole: Record, estimate: Estimate, held_out: Record | None = None, additional: Array | None = None
) -> Handover:
    """Validate a model that was estimated from a whole record.

    Parameters
    ----------
    model : Model
        The model that is written to the file, ``estimate(whole, additional)``.
    whole : Record
        Centred.
    estimate : callable
        Estimates the same structure from any record and from disturbances of its output.
    held_out : Record, optional
        A separate run, which the model itself is validated on.
    additional : ndarray, shape (N, k), optional
        Additional regressors of the output; ``estimate`` gets its rows of them.

    Examples
    --------
    >>> from fitmodels.ident.estimators.least_squares import arx
    >>> u, e = np.random.default_rng(1).standard_normal((2, 600))
    >>> y = Model(b=[0.0, 0.5], a=[1.0, -0.8], nk=1, sample_time=0.02).simulate(u + 0.1 * e)
    >>> rec = Record(u=u, y=y, sample_time=0.02).centred()
    >>> judged = judge_handover(arx(rec, 1, 1), rec, lambda part, additional: arx(part, 1, 1))
    >>> judged.where, judged.reservations
    ('samples 101 to 200 and 401 to 500, the same structure fitted to the others', ())
    """
    own = validate(model, whole, additional=additional)
    if held_out is not None:
        return Handover(validate(model, held_out), own, f"{len(held_out)} held-out samples")
    parts, where = _split(whole, states_of(model))
    if not parts:
        return Handover(own, own, where, unseen=OWN_RECORD)
    (fitted, of_fitted), (other, of_other) = ((_joined(whole, part), _rows(additional, part)) for part in parts)
    if min(_change(fitted), _change(other)) < LITTLE * _change(whole):
        return Handover(own, own, "the estimation record", unseen=UNCHANGED)
    try:
        trained = estimate(fitted, of_fitted)
        structure = validate(trained, other, additional=of_other)
    except IdentError as error:
        unseen = f"the structure could not be validated on {where}: {str(error).rstrip('.')}"
        return Handover(own, own, "the estimation record", unseen=unseen)
    return Handover(structure, own, where, _apart(model, trained, where))


def _change(rec: Record) -> float:
    """Root mean square of the input about the mean of each segment."""
    return float(np.sqrt(sum(np.var(rec.u[s]) * (s.stop - s.start) for s in rec.stretches) / len(rec)))


def _has_last_run(rec: Record) -> bool:
    """Whether the last run of the record can be held out: it and the others are long enough, and of their own."""
    last = rec.starts[-1]
    return len(rec.starts) > 1 and min(last, len(rec) - last) >= FEWEST and _two_runs(rec, last)


def _split(rec: Record, states: int) -> tuple[tuple[list[Span], list[Span]] | tuple[()], str]:
    """Samples to fit and to validate on, none where the record is too short, and a description of the latter."""
    last, n = rec.starts[-1], len(rec)
    if _has_last_run(rec):
        words = f"run {len(rec.starts)} of {len(rec.starts)}, the same structure fitted to the others"
        return ([(0, last)], [(last, n)]), words
    if n // 3 < FEWEST:
        return (), TOO_SHORT
    count = 6 if n // 6 >= max(BLOCK, 6 * states) else 3
    blocks = list(pairwise(k * n // count for k in range(count + 1)))
    ends = [0, *(edge for block in blocks[1::3] for edge in block), n]  # adjacent blocks are one: an edge between them
    fitted = list(zip(ends[::2], ends[1::2], strict=True))
    named = " and ".join(f"{a + 1} to {b}" for a, b in blocks[1::3])
    return (fitted, blocks[1::3]), f"samples {named}, the same structure fitted to the others"


def _two_runs(rec: Record, last: int) -> bool:
    """Whether the last segment is not the longer part and both excite the same band: around a gap they rarely do."""
    if len(rec) > 2.2 * last:  # two runs of nearly one length count
        return False
    low, high = excited_band(rec)
    try:
        bands = [excited_band(rec.part(a, b)) for a, b in ((0, last), (last, len(rec)))]
    except IdentError:  # constant in one of them
        return False
    return all(min(top, high) - max(bottom, low) >= SAME_BAND * (high - low) for bottom, top in bands)


def _joined(rec: Record, part: list[Span]) -> Record:
    """Parts of a record as one, each a segment of its own."""
    return rec.part(*part[0]) if len(part) == 1 else join_records([rec.part(a, b) for a, b in part])


def _rows(additional: Array | None, part: list[Span]) -> Array | None:
    """Rows of the same parts."""
    return None if additional is None else np.concatenate([additional[a:b] for a, b in part])


def _apart(model: Model, trained: Model, where: str) -> str | None:
    """Sentence on the largest significant difference of two models in the excited band."""
    if model.band is None or model.cov_params is None or trained.cov_params is None:
        return None
    f = np.geomspace(*model.band, FREQUENCIES)
    g, other = model.response(f), trained.response(f)
    error = np.hypot(response_error(model, f), response_error(trained, f))
    found = (np.abs(other - g) > APART * np.abs(g)) & (np.abs(other - g) > SIGNIFICANT * error)
    if not found.any():
        return None
    k = int(np.argmax(np.where(found, np.abs(other / g - 1), 0.0)))
    share = abs(other[k] / g[k] - 1)
    return (
        f"the model fitted to all samples and the one that was validated ({where}) differ by {100 * share:.0f} % at "
        f"{f[k]:.3g} Hz, more than their standard errors allow: the structure does not describe the plant, or the "
        "plant changed during the record"
    )


def arx_by_choice(plain: Model, reference: Model, band: tuple[float, float]) -> str:
    """Clause on an ARX model that is used by choice, with its largest difference from the unbiased estimate."""
    f = np.geomspace(*band, FREQUENCIES)
    distance = np.abs(plain.response(f) / reference.response(f) - 1)
    k = int(np.argmax(distance))
    return (
        "the ARX model is used by choice (--handover arx): in the excited band its response differs from that of the "
        f"model of structure {reference.structure!r} by up to {100 * distance[k]:.2g} % (at {f[k]:.3g} Hz); noise of "
        "the sensor biases ARX, and neither its standard errors nor the probability of gains tuned on it contain that "
        "bias"
    )
