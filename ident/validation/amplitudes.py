"""Gain over amplitude: several runs of different amplitude, each fitted with the same structure.

The gain of a linear plant does not depend on the amplitude of its input. With G_i of run i and G of the run of largest
amplitude, |G_i / G - 1| over the excited band is compared with its standard error.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...core.arrays import Array
from ...core.display import Display, Displayable, TextTable
from ...core.errors import IdentError
from ...core.rounding import format_plain
from ...core.verdict import RESERVATIONS, USABLE
from ...datasets.records.record import Record
from ..estimators.bias_checks import response_error
from ..model import Model
from ..responses.spectra import excited_band

if TYPE_CHECKING:
    from ..identification import Identification

FREQUENCIES = 24  # in the common excited band
SIGNIFICANT = 3.5  # standard errors: false alarms 1 % over frequencies and runs
MATTERS = 0.05  # of |G|: a smaller difference is no reservation
DIFFERENT = 1.2  # ratio of the largest to the smallest amplitude that is needed


@dataclass(frozen=True, slots=True, repr=False)
class AmplitudeTable(Displayable):
    """Gain over amplitude.

    Attributes
    ----------
    amplitude : ndarray, shape (R,)
        Half the range of the input of each run, rising, unit_u.
    gain, gain_error : ndarray, shape (R,)
        |G| and its standard error at ``frequency``, where the runs differ most, unit_y per unit_u.
    difference, difference_error : ndarray, shape (R,)
        |G| / |G of the largest amplitude| - 1 at ``frequency``, and its standard error; 0 for the last.
    frequency : float
        Hz.
    band : tuple of float
        Common excited band, Hz.
    unit_u, unit_y : str
    level : int
        Of the verdict: 0, or 1 where the gain depends on the amplitude.
    sentence : str
    """

    amplitude: Array
    gain: Array
    gain_error: Array
    difference: Array
    difference_error: Array
    frequency: float
    band: tuple[float, float]
    unit_u: str
    unit_y: str
    level: int
    sentence: str

    @property
    def table(self) -> TextTable:
        """One row per run: amplitude, gain and its difference from that of the largest amplitude."""
        gain = f"gain at {self.frequency:.3g} Hz"
        header = ("amplitude", gain, "se", "difference", "se")
        unit = f" {self.unit_y}/{self.unit_u}" if self.unit_u and self.unit_y else ""
        rows = tuple(
            (
                f"{a:.4g} {self.unit_u}".rstrip(),
                f"{g:.4g}{unit}",
                f"{e:.2g}",
                f"{100 * d:+.1f} %" if k < len(self.gain) - 1 else "largest",
                f"{100 * s:.1f} %" if k < len(self.gain) - 1 else "",
            )
            for k, (a, g, e, d, s) in enumerate(
                zip(self.amplitude, self.gain, self.gain_error, self.difference, self.difference_error, strict=True)
            )
        )
        return TextTable(header, rows)

    def _display(self) -> Display:
        return Display(self.sentence, (), self.table)


def gain_over_amplitude(runs: Sequence[tuple[Record, Model]]) -> AmplitudeTable:
    """Gain over amplitude of several runs.

    Parameters
    ----------
    runs : sequence of (Record, Model)
        Each run with a model of it, with covariance.

    Raises
    ------
    IdentError
        Fewer than two runs, amplitudes that hardly differ, no common excited band, or models without covariance.

    Examples
    --------
    >>> from fitmodels.ident.estimators.prediction_error import output_error
    >>> rng = np.random.default_rng(1)
    >>> runs = []
    >>> for amplitude in (0.5, 2.0):
    ...     u = amplitude * rng.standard_normal(600)
    ...     y = Model(b=[0.0, 0.5], a=[1.0, -0.5], nk=1, sample_time=0.02).simulate(u) + 0.05 * rng.standard_normal(600)
    ...     rec = Record(u=u, y=y, sample_time=0.02).centred()
    ...     runs.append((rec, output_error(rec, 1, 1)))
    >>> gain_over_amplitude(runs).level
    0
    """
    if len(runs) < 2:
        raise IdentError(f"{len(runs)} run: gain over amplitude needs two runs or more of different amplitude.")
    if any(model.cov_params is None for _, model in runs):
        raise IdentError("gain over amplitude needs models with covariance: identify each run.")
    size = np.array([float(np.ptp(rec.u)) / 2 for rec, _ in runs])
    order = np.argsort(size, kind="stable")
    rec = runs[0][0]
    if size.max() < DIFFERENT * size.min():
        raise IdentError(
            f"the amplitudes of {rec.input}, {size.min():.4g} to {size.max():.4g} {rec.unit_u}, hardly differ: record "
            f"runs whose largest amplitude is {DIFFERENT:g} times the smallest or more; twice is better."
        )
    bands = [excited_band(one) for one, _ in runs]
    band = max(low for low, _ in bands), min(high for _, high in bands)
    if not band[0] < band[1]:
        raise IdentError("the runs excite no common band: record the same signal with different amplitudes.")
    f = np.geomspace(*band, FREQUENCIES)
    gains = np.array([np.abs(runs[k][1].response(f)) for k in order])
    errors = np.array([response_error(runs[k][1], f) for k in order])
    return _compared(rec, size[order], gains, errors, f)


def with_amplitudes(found: "Identification", records: Sequence[Record]) -> "Identification":
    """The identification of several runs with its gain over amplitude: each run is fitted with its structure."""
    from ..record_disturbances import disturbances
    from ..structure.final_estimates import estimated

    named = [disturbances(rec.centred(), closed=found.loop.feedback.found) for rec in records]
    runs = [(one.record, estimated(one.record, found.chosen, one.columns)) for one in named]
    advice = "; record runs of several amplitudes"  # which these are
    items = tuple(replace(item, sentence=item.sentence.partition(advice)[0]) for item in found.disturbances.found)
    disturbed = replace(found.disturbances, found=items)
    return replace(found, amplitudes=gain_over_amplitude(runs), disturbances=disturbed)


def _compared(rec: Record, size: Array, gains: Array, errors: Array, f: Array) -> AmplitudeTable:
    """The table at the frequency where the runs differ most, in standard errors."""
    difference = gains / gains[-1] - 1
    error = np.hypot(errors / gains, errors[-1] / gains[-1]) * (1 + difference)
    score = np.abs(difference[:-1]) / np.maximum(error[:-1], np.finfo(float).tiny)
    found = (score > SIGNIFICANT) & (np.abs(difference[:-1]) > MATTERS)
    row, k = np.unravel_index(int(np.argmax(np.where(found, np.abs(difference[:-1]), 0.0) + 1e-9 * score)), score.shape)
    unit = f" {rec.unit_u}" if rec.unit_u else ""
    if found.any():
        level, sentence = (
            RESERVATIONS,
            f"the gain depends on the amplitude: at {format_plain(size[row], 3)}{unit} it is "
            f"{100 * (1 + difference[row, k]):.0f} % of that at {format_plain(size[-1], 3)}{unit} ({f[k]:.3g} Hz), "
            f"{score[row, k]:.1f} standard errors apart. The plant is not linear: use a model of runs at the amplitude "
            "that the controller will command, and look for a dead zone, backlash or saturation",
        )
    else:
        bound = float(np.max(np.abs(difference[:-1]) + 2 * error[:-1]))
        level, sentence = (
            USABLE,
            f"linear within {100 * bound:.2g} % in gain between amplitudes of {format_plain(size[0], 3)} and "
            f"{format_plain(size[-1], 3)}{unit}, from {f[0]:.3g} to {f[-1]:.3g} Hz",
        )
    return AmplitudeTable(
        size, gains[:, k], errors[:, k], difference[:, k], np.r_[error[:-1, k], 0.0],
        float(f[k]), (float(f[0]), float(f[-1])), rec.unit_u, rec.unit_y, level, sentence,
    )  # fmt: skip
