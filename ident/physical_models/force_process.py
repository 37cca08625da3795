"""Drive and milling process of LYAP from a run of feed command and cutting force.

    drive      m x'' + d x' = f_r                                   (2.1)
    process    F' + c F = k v                                       (2.2)
    together   k f_r = m F'' + (m c + d) F' + d c F                 (2.3, 2.4)

From f_r to F this is (k/m) / ((s + c)(s + d/m)). From a record of f_r and F three numbers are identifiable, k/m and the
pair of poles, but not which pole belongs to the process (c) and which to the drive (d/m); m, d, k are determined up to
a common factor. Given one of m, k, d and the assignment of the poles (``drive``), the others follow: with
r = (m/k, (mc+d)/k, dc/k) the poles -c and -d/m are the roots of r0 s^2 + r1 s + r2, and k = m / r0.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.arrays import Array, is_positive
from ...core.display import Plottable
from ...core.errors import IdentError
from ...core.verdict import DO_NOT_USE, RESERVATIONS, Verdict, verdict_from
from ...datasets import Record
from ...datasets.records.record import averaged_over, join_records
from ...datasets.records.resampling import aliased_teeth, aliased_words, samples_of_revolution
from ..continuous import ContinuousModel, to_continuous
from ..estimators.prediction_error import output_error
from ..model import Model
from ..static_nonlinearity import limits_reached, off_proportion
from . import NOT_HELD_OUT

if TYPE_CHECKING:
    import pandas as pd

Faster = Literal["faster", "slower"]
RATIOS = ("m/k", "(mc+d)/k", "dc/k")
PARAMETERS = ("m", "d", "c", "k")
GOOD, POOR = 80.0, 50.0  # % of fit, as of `validate`
STRUCTURE, SURE = 3.0, 2.0  # standard errors from zero: of a term that must be zero, and of a ratio whose sign is known
USUAL_TEETH = 4  # of a cutter whose number is not stated; samples that fit up to it leave a reservation
CHECKED = ("Structure of the model", "Signs of the ratios", "Simulation of the record")


@dataclass(frozen=True, slots=True, repr=False)
class ForceProcess(Plottable):
    """Drive and milling process estimated from command and force.

    Attributes
    ----------
    ratios : ndarray, shape (3,)
        m/k, (mc+d)/k, dc/k: the parameters that LYAP adapts, in s^2, s and 1 times unit_u per unit_y.
    cov_params : ndarray, shape (3, 3)
        Of ``ratios``, by the delta method from the discrete model.
    parameters : mapping
        m, d, c, k where they follow from the given values; otherwise empty.
    parameter_errors : mapping
        Their standard errors (0: given).
    identifiable : mapping
        Source of each of m, d, c, k and the ratios.
    zero_test : float
        z of the coefficient that is zero by (2.3) (s^1 of the numerator): beyond 3 the model structure is rejected.
    discrete : Model
        The discrete output-error model.
    fit : float
        100 (1 - |F - simulated| / |F - mean F|), %, of the reduced model with estimated initial state.
    time, measured, simulated : ndarray, shape (n,)
        Of the longest segment; the simulation includes the initial state.
    averaged : float
        s over which command and force were averaged before the fit, whole samples of a revolution; 0: not averaged.
    doubts : tuple of (int, str)
        Level of a verdict and a sentence for each fault of the record.
    """

    ratios: Array
    cov_params: Array
    parameters: dict[str, float]
    parameter_errors: dict[str, float]
    identifiable: dict[str, str]
    zero_test: float
    discrete: Model
    fit: float
    time: Array
    measured: Array
    simulated: Array
    input: str
    output: str
    unit_u: str
    unit_y: str
    notes: tuple[str, ...] = ()
    averaged: float = 0.0
    doubts: tuple[tuple[int, str], ...] = ()

    @property
    def params(self) -> "pd.Series[float]":
        """``ratios`` by name."""
        import pandas as pd

        return pd.Series(self.ratios, index=list(RATIOS))

    @property
    def bse(self) -> "pd.Series[float]":
        """Standard errors of ``ratios``."""
        import pandas as pd

        return pd.Series(np.sqrt(np.diag(self.cov_params)), index=list(RATIOS))

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Both poles, rad/s: -c and -d/m in the order of their size, the slower first."""
        roots = np.roots(self.ratios).astype(np.complex128)
        return roots[np.argsort(np.abs(roots))]

    @property
    def continuous(self) -> ContinuousModel:
        """F over f_r."""
        return ContinuousModel(np.ones(1), self.ratios, 0.0, self.input, self.output, self.unit_u, self.unit_y)

    def simulate(self, command: ArrayLike, sample_time: float | None = None) -> Array:
        """Force (N,) from rest on a command (N,) that is held between samples."""
        return self.continuous.sampled(sample_time or self.discrete.sample_time).simulate(command)

    @property
    def verdict(self) -> Verdict:
        """The verdict on the estimates: structure, fit, and ratios that are known."""
        found = [
            *self.doubts,
            *self._of_structure(),
            *(
                (RESERVATIONS, f"{name} is {value:.3g} with a standard error of {error:.2g}: its sign is not known.")
                for name, value, error in zip(RATIOS, self.ratios, self.bse, strict=True)
                if abs(value) < SURE * error
            ),
        ]
        if self.fit < GOOD:
            level, limit = (RESERVATIONS, GOOD) if self.fit >= POOR else (DO_NOT_USE, POOR)
            what = "the force averaged over a revolution" if self.averaged else "the force"
            remedy = "" if self.averaged else " With --spindle it is judged by the force averaged over a revolution."
            found.append((level, f"The model explains {self.fit:.0f} % of {what}, less than {limit:.0f} %.{remedy}"))
        return verdict_from(found, CHECKED, (NOT_HELD_OUT,))

    def _of_structure(self) -> Iterator[tuple[int, str]]:
        if np.abs(self.poles.imag).max() > 0 or not (self.ratios > 0).all():
            yield (
                DO_NOT_USE,
                "The poles are complex or unstable, which no positive m, d, c gives: the model structure is rejected.",
            )
        if abs(self.zero_test) > STRUCTURE:
            yield (
                RESERVATIONS,
                f"The numerator has a term in s, {abs(self.zero_test):.1f} standard errors from zero: drive or process "
                "have another structure than (2.1) and (2.2), or there is a delay.",
            )

    @property
    def df(self) -> int:
        """Degrees of freedom of the standard errors."""
        return max((self.discrete.n or 0) - 4, 1)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each of ``ratios``."""
        per = f"{self.unit_u or '1'}/{self.unit_y or '1'}" if self.unit_u or self.unit_y else ""
        return dict(zip(RATIOS, (f"s^2 {per}".strip(), f"s {per}".strip(), per), strict=True))

    @property
    def words(self) -> str:
        """Estimates with their standard errors, then ``remarks``."""
        values = zip(RATIOS, self.ratios, self.bse, self.units.values(), strict=True)
        text = ", ".join(f"{name} {v:.4g} +- {s:.2g} {unit}".rstrip() for name, v, s, unit in values)
        return " ".join([f"{text}.", *self.remarks])

    @property
    def remarks(self) -> tuple[str, ...]:
        """Fit and poles, and m, d, c, k or the reason why they are not identifiable, a sentence each."""
        poles = " and ".join(f"{p.real:.4g}" if p.imag == 0 else f"{p:.4g}" for p in self.poles)
        over = f" of the force averaged over {1e3 * self.averaged:.4g} ms" if self.averaged else ""
        fit = f"Fit {self.fit:.1f} %{over}; poles {poles} rad/s."
        if not self.parameters:
            free = next(name for name in PARAMETERS if self.identifiable[name] != "given")
            return fit, f"The parameter {free} is {self.identifiable[free]}."
        known = {name: v for name, v in self.parameters.items() if self.identifiable[name] != "given"}
        basis = next(self.identifiable[name] for name in known)
        values = ", ".join(f"{name} {v:.4g} +- {self.parameter_errors[name]:.2g}" for name, v in known.items())
        return fit, f"{basis[0].upper()}{basis[1:]}: {values}."


def force_process_fit(
    rec: Record | Sequence[Record],
    *,
    m: float | None = None,
    k: float | None = None,
    d: float | None = None,
    drive: Faster | None = None,
    revolution: float | None = None,
    teeth: int | None = None,
    proportional: bool = True,
) -> ForceProcess:
    """Fit LYAP's drive and process (eq. 2.1-2.4) to a run of feed command f_r and cutting force F.

    Parameters
    ----------
    rec : Record or sequence of Record
        Input f_r, output F, at one depth of cut (k is proportional to it), sampled well above both poles. F is 0 at f_r
        0 by (2.3): remove the idle force (``rec.less``) or the operating point (``rec.centred()``).
    m, k, d : float or None
        At most one known value, in units consistent with the record.
    drive : {"faster", "slower"} or None
        Whether the pole of the drive d/m is the faster one; required with m, k or d, as it is not identifiable.
    revolution : float or None
        s of a revolution of the spindle. The ripple of the teeth is no part of (2.2), so command and force are averaged
        over a revolution, in whole samples; a record with fewer than two in it is not averaged.
    teeth : int or None
        Of the cutter: whether the samples of a revolution give its mean force (`aliased_teeth`).
    proportional : bool
        Whether the control takes the force in proportion to the feed, so that an offset between them is a doubt.

    Raises
    ------
    IdentError
        More than one value given; a record too short, constant or without a continuous form of second order.

    Notes
    -----
    An output-error model with two poles is converted to continuous time; the term in s of its numerator, zero by (2.3),
    is constrained to zero, and the other coefficients are adjusted by their covariance (constrained estimate).

    Examples
    --------
    >>> from fitmodels.ident.continuous import sampled
    >>> u = np.sin(0.0005 * np.arange(1500.0) ** 2)
    >>> F = sampled([400.0], [2.0, 2.0 * 8 + 60, 60 * 8.0], 0.01).simulate(u)  # k 400, m 2, c 8, d 60
    >>> fit = force_process_fit(Record(u=u, y=F, sample_time=0.01), m=2.0, drive="faster")
    >>> {name: round(value, 4) for name, value in fit.parameters.items()}
    {'m': 2.0, 'd': 60.0, 'c': 8.0, 'k': 400.0}
    """
    given = {name: value for name, value in (("m", m), ("k", k), ("d", d)) if value is not None}
    if len(given) > 1:
        raise IdentError(f"{' and '.join(given)} given: the others follow from one of them; give one.")
    for name, value in given.items():
        if not is_positive(value):
            raise IdentError(f"{name} {value!r}: above zero.")
    if drive not in (None, "faster", "slower"):
        raise IdentError(f"drive {drive!r}: 'faster' or 'slower', its pole d/m relative to the process pole c.")

    rec = rec if isinstance(rec, Record) else join_records(rec)
    doubts, recorded = [*_of_sampling(rec, revolution, teeth)], rec
    window = 0 if revolution is None else round(revolution / rec.sample_time)
    window = window if window > 1 else 0
    rec = averaged_over(rec, window) if window else rec
    discrete = output_error(rec, nb=2, nf=2, nk=1)
    ratios, cov, zero = _ratios(discrete)
    doubts += limits_reached(recorded, rec, window)
    if proportional and ratios[2] > 0:
        doubts += off_proportion(recorded, float(ratios[2]), float(np.sqrt(cov[2, 2])))
    values, errors = parameters_of(ratios, cov, given, drive)
    simulated, fit = _free_run(rec, ratios)
    s = max(rec.stretches, key=lambda s: s.stop - s.start)
    return ForceProcess(
        ratios, cov, values, errors, basis_of(ratios, given, drive), zero, discrete, fit,
        np.arange(s.stop - s.start) * rec.sample_time, rec.y[s], simulated[s],
        rec.input, rec.output, rec.unit_u, rec.unit_y, discrete.notes, window * rec.sample_time,
        tuple(doubts),
    )  # fmt: skip


def _of_sampling(rec: Record, revolution: float | None, teeth: int | None) -> Iterator[tuple[int, str]]:
    """The samples of a revolution against the teeth."""
    if revolution is None or not (aliased := aliased_teeth(revolution, rec.sample_time, teeth)):
        return
    few = teeth is None and aliased[0] > USUAL_TEETH
    rate = samples_of_revolution(revolution / rec.sample_time, teeth) / revolution
    wrong = aliased_words(revolution, rec.sample_time, aliased, teeth)
    or_state = "" if teeth else ", or state the number of teeth (--teeth)"
    yield (
        RESERVATIONS if few else DO_NOT_USE,
        f"{wrong}, and the gain is that of these angles. Record at {rate:.4g} Hz{or_state}; a force that was low-pass "
        "filtered below the spindle frequency before it was sampled needs no --spindle.",
    )


def _ratios(model: Model) -> tuple[Array, Array, float]:
    """m/k, (mc+d)/k, dc/k, their covariance, and z of the term that is zero by (2.3)."""
    p = _continuous(model, model.theta)
    if isinstance(p, str):
        raise IdentError(f"the force process has no continuous form: {p}.")
    J = np.empty((4, 4))
    bse = np.sqrt(np.diag(model.cov_params)) if model.cov_params is not None else np.zeros(4)
    for j in range(4):
        h = np.zeros(4)
        h[j] = max(1e-3 * bse[j], 1e-7 * abs(model.theta[j]))
        up, down = _continuous(model, model.theta + h), _continuous(model, model.theta - h)
        for end in (up, down):
            if isinstance(end, str):
                raise IdentError(f"the continuous form of the force process is at its limit of existence: {end}.")
        J[:, j] = np.subtract(up, down) / (2 * h[j])
    cov = J @ (np.zeros((4, 4)) if model.cov_params is None else model.cov_params) @ J.T
    zero, known = 0.0, cov[0, 0] > (1e-9 * max(abs(p[0]), abs(p[1]) * model.sample_time)) ** 2
    if known:
        zero = float(p[0] / np.sqrt(cov[0, 0]))
        pull = cov[:, 0] / cov[0, 0]
        p, cov = p - pull * p[0], cov - np.outer(pull, cov[0])
    n0, a1, a0 = p[1:]
    back = np.array([[-1, 0, 0], [-a1, n0, 0], [-a0, 0, n0]]) / n0**2
    return np.array([1.0, a1, a0]) / n0, back @ cov[1:, 1:] @ back.T, zero


def _continuous(model: Model, theta: Array) -> Array | str:
    """n1, n0, a1, a0 of (n1 s + n0) / (s^2 + a1 s + a0), or the reason why there is none."""
    form = to_continuous(Model(b=np.r_[0.0, theta[2:]], a=np.r_[1.0, theta[:2]], nk=1, sample_time=model.sample_time))
    if not isinstance(form, ContinuousModel):
        return form.reason
    return np.asarray(np.r_[np.zeros(2 - len(form.num)), form.num, form.den[1:]], dtype=np.float64)


def _free_run(rec: Record, ratios: Array) -> tuple[Array, float]:
    """Simulated force (N,) with estimated initial states, and its fit in %."""
    from ..estimators.free_simulation import free_run, simulation_error

    model = ContinuousModel(np.ones(1), ratios).sampled(rec.sample_time)
    e = simulation_error(free_run(rec, 2, 2, 1, free=True), model.theta)
    return rec.y - e, 100 * (1 - float(np.linalg.norm(e) / np.linalg.norm(rec.y - rec.y.mean())))


def parameters_of(
    ratios: Array, cov: Array, given: Mapping[str, float], drive: str | None
) -> tuple[dict[str, float], dict[str, float]]:
    """Values and standard errors (delta method) of m, d, c, k; both empty where they are not identifiable.

    >>> r = np.array([2.0, 76.0, 480.0]) / 400
    >>> values, _ = parameters_of(r, np.zeros((3, 3)), {"k": 400.0}, "faster")
    >>> {name: round(value, 9) for name, value in values.items()}
    {'m': 2.0, 'd': 60.0, 'c': 8.0, 'k': 400.0}
    """
    if _open(ratios, given, drive):
        return {}, {}
    values = _values(ratios, given, drive)
    J = np.empty((4, 3))
    for j in range(3):
        h = np.zeros(3)
        h[j] = 1e-6 * abs(ratios[j])
        J[:, j] = (_values(ratios + h, given, drive) - _values(ratios - h, given, drive)) / (2 * h[j])
    errors = np.sqrt(np.maximum(np.diag(J @ cov @ J.T), 0.0))
    names = ("m", "d", "c", "k")
    all_errors = dict(zip(names, errors.tolist(), strict=True)) | dict.fromkeys(given, 0.0)
    return dict(zip(names, values.tolist(), strict=True)), all_errors


def basis_of(ratios: Array, given: Mapping[str, float], drive: str | None) -> dict[str, str]:
    """Source of each of m, d, c, k and the ratios."""
    basis = dict.fromkeys(("m/k", "(mc+d)/k", "dc/k"), "from the record alone")
    slow, fast = np.sort(np.abs(np.roots(ratios)))
    pair = f"c and d/m are {slow:.4g} and {fast:.4g} rad/s, in an order that is not identifiable"
    why = _open(ratios, given, drive)
    for name in ("m", "d", "c", "k"):
        if name in given:
            basis[name] = "given"
        else:
            basis[name] = f"not identifiable: {why}" if why else f"from the record, with {_with(given, drive)}"
    if "complex" not in why:
        basis["c, d/m"] = pair if not drive else f"from the record, with the drive taken as {drive}"
    return basis


def _with(given: Mapping[str, float], drive: str | None) -> str:
    return " and ".join([*(f"{n} {v:g} given" for n, v in given.items()), f"the drive taken as {drive}"])


def _open(ratios: Array, given: Mapping[str, float], drive: str | None) -> str:
    """Reason why m, d, c, k are not identifiable; empty if they are."""
    roots = np.roots(ratios)
    if np.abs(np.imag(roots)).max() > 0 or not (ratios > 0).all():
        return "the poles are complex or unstable, which no positive m, d, c gives"
    if not given:
        return "m, d and k only as the products m/k, (mc+d)/k and dc/k; give one of m, k, d (--given m=VALUE)"
    if not drive:
        return "the pole of the drive is not identified; give drive='faster' or 'slower' (--drive-pole)"
    return ""


def _values(ratios: Array, given: Mapping[str, float], drive: str | None) -> Array:
    """m, d, c, k."""
    slow, fast = np.sort(np.abs(np.roots(ratios)))
    pole, c = (fast, slow) if drive == "faster" else (slow, fast)
    ((name, value),) = given.items()
    m = {"m": value, "k": value * ratios[0], "d": value / pole}[name]
    return np.array([m, m * pole, c, m / ratios[0]])
