"""Inertia and friction of a feed drive from its force and its motion.

    F = M a + Fv v + Fc sign(v) + offset

Inverse-model least squares: position differentiated centrally, every column of the equation and the force filtered by
one zero-phase low-pass, then every k-th row. Source: Gautier 1997, doi 10.1109/ROBOT.1997.619069; Janot, Vandanjon &
Gautier 2014, doi 10.1109/TCST.2013.2248366. In addition, a force held between samples acts on a second difference with
the mean of two samples, half a sample late, and rows near a reversal, where friction is not Coulomb's, are omitted.

Lag of the motion: F(t - lag) has the derivative -F'(t) by the lag, a fifth column. By its estimate the force is taken
as held (0.5 samples) or as measured at the sample (0), or with the delay that is left where neither agrees.

Standard errors: block jackknife (Kunsch 1989, doi 10.1214/aos/1176347265, section 2, without overlap), since the
residuals are autocorrelated by an unknown law. For least squares the estimate without block i is

    theta_i = theta - (J'J - Ji'Ji)^-1 Ji' e_i

so that no refit is needed. Blocks longer than the correlation of the residuals give valid errors, also for model error
(friction that is not exactly Coulomb's). Blocks in phase with a periodic movement would all contain the same error and
make the standard error several times too small: several block lengths are used, and the largest result is taken.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ...core.arrays import Array
from ...core.display import Plottable
from ...core.errors import IdentError
from ...core.verdict import DO_NOT_USE, RESERVATIONS, Verdict, verdict_from
from ...datasets import Record
from ...datasets.records.record import join_records
from . import NOT_HELD_OUT
from .equation_of_motion import COUNTS, HELD, FilteredRows, Motion, motion_of, rows_of, velocity_and_travel, widest

if TYPE_CHECKING:
    import pandas as pd

NAMES = ("M", "Fv", "Fc", "offset")
INDEPENDENT = 0.02  # share of a column orthogonal to the others: below it, its coefficient is not identifiable

LARGE, TOO_LARGE = 0.2, 0.5  # share of the force that is not explained
DF = 13  # of the standard errors: a 95 % interval spans 2.2 of them
GOOD, POOR = 80.0, 50.0  # % of fit, as of `validate`
TIMING = "Delay of the motion"
CHECKED = ("Share of the force explained", "Signs of inertia and friction", "Simulation of the record", TIMING)
AGREES, SURE = 0.4, 3.0  # samples of lag that do not matter (a sound machine has 0.3), and standard errors
LATE = 1.0  # samples of delay that a simulation needs
STEPS, WIDEST, EXACT = 12, 5.0, 0.01  # iterations of the lag, and their largest and smallest change in samples
SLIDES = (1.0, 1e5)  # kg


@dataclass(frozen=True, slots=True, repr=False)
class DriveFit(Plottable):
    """Inertia and friction of a drive.

    Attributes
    ----------
    theta : ndarray, shape (4,)
        M kg, Fv N s/m, Fc N, offset N (kg m^2, N m s/rad, N m, N m of a rotary drive).
    cov_params : ndarray, shape (4, 4)
        By block jackknife, which allows for autocorrelated residuals and model error; about 13 degrees of freedom, so
        that a 95 % interval spans 2.2 standard errors.
    relative_error : float
        Norm of the residual force over that of the force, filtered.
    rows, left_out : int
        FilteredRows used, and omitted near reversals.
    motion : Motion
        Force and motion of the record in SI units.
    rate, cutoff : float
        Hz: of the rows, and of the low-pass.
    predicted : ndarray, shape (rows, 2)
        Measured and modelled force, N, filtered.
    notes : tuple of str
    lag : tuple of float, or None
        Samples by which the motion follows the force (0.5 of a held force), and the standard error; None where the
        record does not show it.
    stated : bool
        Whether the force is held was stated, not chosen by the record.
    """

    theta: Array
    cov_params: Array
    relative_error: float
    rows: int
    left_out: int
    motion: Motion
    rate: float
    cutoff: float
    predicted: Array
    notes: tuple[str, ...] = ()
    lag: tuple[float, float] | None = None
    stated: bool = False

    @property
    def M(self) -> float:
        """Inertia, kg."""
        return float(self.theta[0])

    @property
    def Fv(self) -> float:
        """Viscous friction, N s/m."""
        return float(self.theta[1])

    @property
    def Fc(self) -> float:
        """Coulomb friction, N."""
        return float(self.theta[2])

    @property
    def offset(self) -> float:
        """Constant force offset, N."""
        return float(self.theta[3])

    @property
    def params(self) -> "pd.Series[float]":
        """``theta`` by name."""
        import pandas as pd

        return pd.Series(self.theta, index=list(NAMES))

    @property
    def bse(self) -> "pd.Series[float]":
        """Standard errors by name."""
        import pandas as pd

        return pd.Series(np.sqrt(np.diag(self.cov_params)), index=list(NAMES))

    def simulate(
        self, force: ArrayLike, sample_time: float | None = None, v0: float = 0.0, x0: float = 0.0
    ) -> tuple[Array, Array]:
        """Velocity (N,) m/s and position (N,) m from force (N,) in N alone, held between samples; sticking included.

        ``sample_time`` in s is that of the record unless given.
        """
        if not self.possible:
            raise IdentError(
                f"inertia {self.M:.4g}, Coulomb friction {self.Fc:.4g}: physically impossible. Check the sign of force "
                "(force=-...) and the units."
            )
        dt = self.motion.sample_time if sample_time is None else float(sample_time)
        F = np.asarray(force, dtype=np.float64)
        v, x = velocity_and_travel(F, dt, self.M, self.Fv, self.Fc, self.offset, v0)
        return v, x + x0

    def free_run(self, rec: Record | Sequence[Record], unit: str | None = None) -> tuple[Array, Array, float]:
        """Velocity measured and simulated from the force alone (N,), m/s, and the fit in %.

        Each segment starts at its measured speed. The fit is 100 (1 - |v - simulated| / |v - mean v|).
        """
        rec = rec if isinstance(rec, Record) else join_records(rec)
        known = unit or rec.unit_y or self.motion.unit
        motion = motion_of(rec, self.motion.factor, known, self.cutoff, self.motion.held)
        motion = replace(motion, delay=self.motion.delay)
        return motion.v, *self._run(motion)

    @property
    def own_run(self) -> tuple[Array, float]:
        """Velocity simulated on the estimation record (N,), m/s, and the fit in %."""
        return self._run(self.motion)

    def _run(self, motion: Motion) -> tuple[Array, float]:
        force, dt = motion.acting, motion.sample_time
        runs = [self.simulate(force[s], dt, float(motion.v[s][0]))[0] for s in motion.stretches]
        simulated = np.concatenate(runs)
        spread = float(np.linalg.norm(motion.v - motion.v.mean()))
        return simulated, 100 * (1 - float(np.linalg.norm(motion.v - simulated)) / spread)

    @property
    def possible(self) -> bool:
        """Whether inertia and Coulomb friction have the signs that a simulation needs."""
        return self.M > 0 and self.Fc >= 0

    @property
    def df(self) -> int:
        """Degrees of freedom of the standard errors, about."""
        return DF

    @property
    def units(self) -> dict[str, str]:
        """Unit of each parameter."""
        rotary = self.motion.speed_unit == "rad/s"
        inertia, viscous, force = ("kg m^2", "N m s/rad", "N m") if rotary else ("kg", "N s/m", "N")
        return dict(zip(NAMES, (inertia, viscous, force, force), strict=True))

    @property
    def words(self) -> str:
        """Estimates with their standard errors, then ``remarks``."""
        values = zip(NAMES, self.theta, self.bse, self.units.values(), strict=True)
        return " ".join([", ".join(f"{n} {v:.5g} +- {s:.2g} {unit}" for n, v, s, unit in values) + ".", *self.remarks])

    @property
    def remarks(self) -> tuple[str, ...]:
        """Share of the force that is not explained, fit of the simulation, and findings, a sentence each."""
        run = [f"Simulated from the force alone: fit {self.own_run[1]:.1f} % of the speed."] if self.possible else []
        share = (
            f"Force that is not explained: {100 * self.relative_error:.2g} % ({self.rows} rows, {self.left_out} near "
        )
        found = (words for _, words in self._findings())
        return (f"{share}reversals left out).", *run, self._timing, *found)

    @property
    def _timing(self) -> str:
        """The sentence on how the force is taken between samples, and by which evidence."""
        taken = "held until the next sample" if self.motion.held else "measured at the sample"
        if self.stated:
            return f"The force is {taken}, as stated."
        if self.lag is None:
            return f"The force is taken as {taken}: the record does not show its delay."
        late = f"{self.lag[0]:.2f} +- {self.lag[1]:.1g} samples (held 0.5, measured 0)"
        if self.motion.delay:
            return f"The force is taken with the delay that the record shows: the motion follows it by {late}."
        return f"The force is taken as {taken}: the motion follows it by {late}."

    @property
    def verdict(self) -> Verdict:
        """The verdict on the estimates: share of the force explained, signs, and free run."""
        found = list(self._findings())
        percent = self.own_run[1] if self.possible else 0.0
        if self.possible and percent < GOOD:
            level, limit = (RESERVATIONS, GOOD) if percent >= POOR else (DO_NOT_USE, POOR)
            found.append(
                (
                    level,
                    f"Simulated from the force alone, the model explains {percent:.0f} % of the speed, less than "
                    f"{limit:.0f} %.",
                )
            )
        if self.lag is None:
            done = tuple(one for one in CHECKED if one != TIMING)
            return verdict_from(found, done, (NOT_HELD_OUT, f"{TIMING}: the record does not show it"))
        return verdict_from(found, CHECKED, (NOT_HELD_OUT,))

    def _findings(self) -> Iterator[tuple[int, str]]:
        se = self.bse.to_numpy()
        weak = [n for n, v, s in zip(NAMES[:3], self.theta, se, strict=False) if abs(v) < 2 * s]
        if (self.theta[:3] < -2 * se[:3]).any():
            yield (
                DO_NOT_USE,
                "A negative value means that the force is opposite to the motion: give force with a minus sign.",
            )
        elif not self.possible:
            yield DO_NOT_USE, f"Inertia {self.M:.4g} and Coulomb friction {self.Fc:.4g}: physically impossible."
        if self.relative_error > LARGE:
            yield (
                DO_NOT_USE if self.relative_error > TOO_LARGE else RESERVATIONS,
                f"{100 * self.relative_error:.0f} % of the force is not explained, more than {100 * LARGE:.0f} %: "
                "another force acts, or time or units of force and motion do not match.",
            )
        if self.possible and self.motion.speed_unit != "rad/s" and not SLIDES[0] <= self.M <= SLIDES[1]:
            yield (
                RESERVATIONS,
                f"The moving mass of {self.M:.3g} kg is outside the {SLIDES[0]:g} to {SLIDES[1]:.0f} kg of machine "
                "tools: check the units of motion and force.",
            )
        if self.lag is not None and (words := self._late(*self.lag)):
            yield RESERVATIONS, words
        if weak:
            yield (
                RESERVATIONS,
                f"{' and '.join(weak)} not significantly different from zero: excite more speeds, or higher ones.",
            )

    def _late(self, lag: float, error: float) -> str:
        """Sentence on a delay that matters, empty without one."""
        motion = self.motion
        seconds = lag * motion.sample_time
        if self.stated and abs(lag - motion.lag) > max(AGREES, SURE * error):
            kind = "held until the next sample" if motion.held else "measured at the sample"
            return (
                f"The motion follows the force by {lag:.2f} samples ({seconds:.2g} s), not by {motion.lag:.1f} as with "
                f"a force {kind}: inertia and friction are wrong. Leave the timing of the force to the record."
            )
        if abs(motion.delay) < LATE:
            return ""
        return (
            f"The motion follows the force by {seconds:.3g} s ({lag:.1f} samples): inertia and friction are estimated "
            "with this delay, which the file does not hold. Record both with one clock, or add it in a simulation."
        )


def drive_fit(
    rec: Record | Sequence[Record],
    force: float | None = None,
    *,
    unit: str | None = None,
    held: bool | None = None,
    cutoff: float | None = None,
    slow: float = 0.05,
) -> DriveFit:
    """Inertia M, viscous Fv, Coulomb Fc and offset of a drive from a record of force and position (or velocity).

    Parameters
    ----------
    rec : Record or sequence of Record
        Input: force, or a signal proportional to it (current, control voltage). Output: position or velocity. Closed
        loop is allowed. Motion in both directions, with acceleration and constant speed.
    force : float or None
        N (or N m) for one unit of the input; None where the input is in N, kN or N m already.
    unit : str or None
        Of the output (m, mm, um, mm/s, mm/min, m/s, m/min, rad, deg, rad/s, rpm), if the record names none.
    held : bool or None
        The force is a command held until the next sample; False: measured at the sample. None: chosen by the record,
        with a delay where the motion follows neither.
    cutoff : float or None
        Low-pass, Hz; by default 0.04 of the sample rate. Well above the motion, below resonances.
    slow : float
        FilteredRows within the filter length of a speed below this share of the top speed are omitted.

    Raises
    ------
    IdentError
        Unknown units; too short a record; a drive at rest, moving in one direction only, or at one speed only.

    Examples
    --------
    >>> t = np.arange(8000) * 1e-3
    >>> F = 40 * np.sign(np.sin(2.5 * t)) + 30 * np.sin(9 * t)
    >>> x = velocity_and_travel(F, 1e-3, M=20.0, Fv=50.0, Fc=8.0, offset=1.0)[1]
    >>> drive_fit(Record(u=F, y=x, sample_time=1e-3, unit_u="N", unit_y="m")).params.round(1).to_dict()
    {'M': 20.0, 'Fv': 50.0, 'Fc': 8.0, 'offset': 1.0}
    """
    if not 0 <= slow < 0.5:
        raise IdentError(f"slow {slow!r}: a share of the top speed, at least 0 and below 0.5.")
    rec = rec if isinstance(rec, Record) else join_records(rec)
    motion = motion_of(rec, force, unit, cutoff, held is not False)
    _check_rows(rows_of(motion, slow))
    lag = _lag(motion, slow)
    if held is None and lag is not None:
        motion = _timed(motion, *lag)
    rows = rows_of(motion, slow)
    theta, e = _solved(rows.X, rows.F)
    return DriveFit(
        theta=theta, cov_params=widest(rows.X, e, rows.time), rows=len(e), left_out=rows.left_out, lag=lag,
        stated=held is not None,
        relative_error=float(np.linalg.norm(e) / np.linalg.norm(rows.F)), motion=motion, rate=rows.rate,
        cutoff=motion.cutoff, predicted=np.column_stack([rows.F, rows.F - e]), notes=(*rec.notes, *motion.notes),
    )  # fmt: skip


def _solved(X: Array, F: Array) -> tuple[Array, Array]:
    """Least-squares coefficients, and residuals."""
    scale = np.linalg.norm(X, axis=0)
    theta = np.asarray(np.linalg.lstsq(X / scale, F, rcond=None)[0] / scale)
    return theta, F - X @ theta


def _lag(motion: Motion, slow: float) -> tuple[float, float] | None:
    """Samples by which the motion follows the force, and the standard error; None where the record does not show it."""
    most = 1 / (motion.cutoff * motion.sample_time)  # of the low-pass: the samples that are omitted at the ends
    for _ in range(STEPS):
        rows = rows_of(motion, slow)
        J = np.column_stack([rows.X, rows.change])
        theta, e = _solved(J, rows.F)
        motion = replace(motion, delay=motion.delay + float(np.clip(theta[4], -WIDEST, WIDEST)))
        if abs(motion.lag) > most:
            return None
        if abs(theta[4]) < EXACT:
            shown = theta[0] > 0 and np.linalg.norm(e) < LARGE * np.linalg.norm(rows.F)
            return (motion.lag, float(np.sqrt(widest(J, e, rows.time)[4, 4]))) if shown else None
    return None


def _timed(motion: Motion, lag: float, error: float) -> Motion:
    """The motion with a force that is held, or measured, and with the delay that is left where it matters."""
    held = abs(lag - HELD) < max(abs(lag), 2 * error)
    left = lag - HELD * held
    return replace(motion, held=held, delay=left if abs(left) > max(AGREES, SURE * error) else 0.0)


def _check_rows(rows: FilteredRows) -> None:
    """Raise IdentError unless the four coefficients are identifiable from the rows."""
    fewest = 4 * max(COUNTS)
    if len(rows.F) < fewest:
        raise IdentError(
            f"{len(rows.F)} rows at {rows.rate:.4g} Hz remain, besides {rows.left_out} near reversals; "
            f"{fewest} are needed. Record longer, raise cutoff or lower slow."
        )
    if not ((rows.X[:, 2] > 0.9).any() and (rows.X[:, 2] < -0.9).any()):
        raise IdentError(
            "the drive moves in one direction only: Coulomb friction and offset are not separable. "
            "Record motion in both directions."
        )
    X = rows.X / np.linalg.norm(rows.X, axis=0)
    independent = 1 / np.sqrt(np.diag(np.linalg.pinv(X.T @ X)))
    if independent.min() < INDEPENDENT:
        name = NAMES[int(np.argmin(independent))]
        raise IdentError(
            f"{name} is not identifiable from this record: {100 * independent.min():.2g} % of its column is "
            f"independent of the others, {100 * INDEPENDENT:.0f} % are needed. Move at several speeds and accelerate."
        )
