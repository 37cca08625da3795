"""Models built from estimates: covariance, noise variance, record, and notes on convergence."""

from typing import Any

import numpy as np

from ...core.arrays import Array
from ...datasets.records.record import Record
from ..model import Model, Structure
from .filters import ROUNDING, covariance, inverse_of_squares, squares
from .free_simulation import FreeRun, constants, sensitivities
from .input_checks import check_identifiable, not_centred


def record_facts(rec: Record) -> dict[str, Any]:
    """Attributes of a model that stem from its record."""
    lengths = [s.stop - s.start for s in rec.stretches]
    mean = np.average(np.asarray(rec.offsets), axis=0, weights=lengths)
    return {
        "n": len(rec), "record": rec.sha256, "sample_time": rec.sample_time, "input": rec.input, "output": rec.output,
        "unit_u": rec.unit_u, "unit_y": rec.unit_y, "operating_point": (float(mean[0]), float(mean[1])),
    }  # fmt: skip


def slow_pole(a: Array, longest: int) -> tuple[str, ...]:
    """A note on a pole slower than the longest segment, which represents an integrator or a drift."""
    radius = float(np.abs(np.roots(a)).max(initial=0.0))
    if (1 - radius) * longest > 1:
        return ()
    return (
        f"a pole at radius {radius:.7g} is slower than the longest segment of {longest} samples: the plant integrates, "
        "or the output drifts. Identify from input to the change of the output, or remove the drift (--trend; in "
        "Python trend=True).",
    )


def convergence_note(steps: int, converged: bool, method: str) -> str:
    """Whether the iteration converged and after how many steps, for ``notes``."""
    count = f"{steps} {method} step{'s' if steps != 1 else ''}"
    return f"converged after {count}" if converged else f"not converged: stopped after {count}"


def output_error_model(rec: Record, run: FreeRun, theta: Array, structure: Structure, notes: tuple[str, ...]) -> Model:
    """The model of an estimate with its covariance."""
    e, J = sensitivities(run, theta)
    check_identifiable(J, {"na" if structure == "sriv" else "nf": run.na, "nb": run.nb})
    variance = squares(e) / max(len(e) - len(theta) - run.hidden, 1)
    cov, colour = variance * inverse_of_squares(J), 0
    if squares(e) > 1e4 * ROUNDING * squares(run.y):  # rounding is coloured too
        cov, colour = covariance(J, e, run.stretches, run.hidden)
    notes += (*rec.notes, *not_centred(rec))
    if run.free:
        notes += (f"initial state {'and offset ' if run.constant else ''}of each segment estimated",)
    if colour:
        notes += (f"coloured noise (autoregression of order {colour}), allowed for in the standard errors",)
    b, a = run.polynomials(theta)
    notes += slow_pole(a, max(s.stop - s.start for s in run.stretches))
    from_record = record_facts(rec)
    if run.constant:
        weights = [s.stop - s.start for s in run.stretches]
        u0, y0 = from_record["operating_point"]
        from_record["operating_point"] = (u0, y0 + float(np.average(constants(run, theta), weights=weights)))
    return Model(
        b=b, a=a, nk=run.nk, structure=structure, cov_params=cov, notes=notes,
        noise_variance=variance, **from_record,
    )  # fmt: skip
