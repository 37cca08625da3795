"""Display of the results of this package: one registered function per class."""

import numpy as np
from numpy.typing import NDArray

from ..core.display import Display, TextTable, by_fields, display_of, estimates, facts_of
from ..core.rounding import format_plain as plain
from ..core.rounding import with_error
from .continuous import ContinuousModel
from .excitation.predicted_precision import PredictedErrors
from .identification import Identification
from .model import Model
from .physical_models.drive import DriveFit
from .physical_models.force_process import ForceProcess
from .physical_models.step_response import StepFit
from .pi.controller import LoopTrace
from .pi.feasible_region import FeasibleMap
from .pi.gains import PiGains
from .pi.loop import Loop
from .pi.published_gains import PiCheck
from .pi.tuning import TunedPi
from .responses.confidence_bands import ResponseBand, StepBand
from .responses.frequency import FrequencyResponse

MOST_ROWS = 8


def _ratio(above: str, below: str) -> str:
    return f" {above}/{below}" if above and below else ""


def _poles(poles: NDArray[np.complex128]) -> str:
    """Poles, pairs as one: ``0.75 ± 0.19j``."""
    shown = [
        plain(p.real) if abs(p.imag) < 1e-12 else f"{plain(p.real)} ± {plain(p.imag)}j"
        for p in poles if p.imag > -1e-12
    ]  # fmt: skip
    return ", ".join(shown) or "none"


@display_of.register
def of_model(model: Model) -> Display:
    """Orders, gain, poles; the coefficients with their standard errors."""
    rows = "" if model.n is None else f", from {model.n} samples"
    per = _ratio(model.unit_y, f"({model.unit_u} s)" if model.integrating and model.unit_u else model.unit_u)
    gain = f"{plain(model.rate_gain if model.integrating else model.dc_gain)}{per}"
    stability = "" if model.stable else ", integrating" if model.integrating else ", UNSTABLE"
    others = f", {len(model.alternatives)} alternatives" if model.alternatives else ""
    head = (
        f"{model.structure.replace('_', ' ')} of {model.input} to {model.output}, na {model.na}, nb {model.nb}, "
        f"nk {model.nk} at {model.sample_time:g} s, gain {gain}, poles {_poles(model.poles)}{stability}{rows}{others}"
    )
    facts = () if model.band is None else (("excited band", f"{model.band[0]:.3g} to {model.band[1]:.3g} Hz"),)
    errors = [None] * len(model.theta) if model.cov_params is None else list(model.bse)
    return Display(head, facts, estimates(model.names, model.theta, errors), model.notes)


@display_of.register
def of_continuous(model: ContinuousModel) -> Display:
    """Gain, poles, zeros and delay."""
    facts = (
        ("gain", f"{plain(model.dc_gain)}{_ratio(model.unit_y, model.unit_u)}"),
        ("poles", f"{_poles(model.poles)} rad/s"),
        *((("zeros", f"{_poles(model.zeros)} rad/s"),) if model.zeros.size else ()),
        ("delay", f"{model.delay:g} s"),
    )
    return Display(f"{model.input} to {model.output}: " + ", ".join(" ".join(fact) for fact in facts), facts)


@display_of.register
def of_frequency(found: FrequencyResponse) -> Display:
    """Number and range of frequencies, excited band and gain; a table of a few of them."""
    f, inside = found.frequency, ~found.outside
    low, high = found.band
    gains = found.gain[inside] if inside.any() else found.gain
    head = (
        f"gain and phase at {len(f)} frequencies, {f[0]:.3g} to {f[-1]:.3g} Hz ({found.method}); excited {low:.3g} to "
        f"{high:.3g} Hz, gain there {plain(gains.min(), 3)} to {plain(gains.max(), 3)}"
    )
    return Display(head, (("resolution", f"{found.resolution:.3g} Hz"),), _over(found), found.notes)


@display_of.register
def of_band(found: ResponseBand) -> Display:
    """Number and range of frequencies, largest error; a table of a few of them."""
    f = found.frequency
    head = (
        f"gain and phase at {len(f)} frequencies, {f.min():.3g} to {f.max():.3g} Hz, within pointwise "
        f"{100 * found.level:g} % bands; standard error of the gain at most {100 * found.gain_error.max():.2g} %"
    )
    return Display(head, (), _over(found), (found.concern,) if found.concern else ())


def _over(found: "FrequencyResponse | ResponseBand") -> TextTable:
    """Table of gain and phase with standard errors at a few frequencies."""
    rows = []
    for k in np.unique(np.linspace(0, len(found.frequency) - 1, MOST_ROWS).astype(int)):
        share, turn = float(found.gain_error[k]), float(found.phase_error[k])
        gain, phase = float(found.gain[k]), float(found.phase[k])
        shown = with_error(gain, share * gain) if share < 1 else "not known"
        rows.append((f"{found.frequency[k]:.3g}", shown, with_error(phase, turn) if share < 1 else ""))
    return TextTable(("Hz", "gain", "phase, degrees"), tuple(rows))


@display_of.register
def of_step_band(found: StepBand) -> Display:
    """Final value of the step response with its standard error."""
    end = with_error(float(found.step[-1]), float(found.error[-1]))
    return Display(f"response to a unit step over {found.time[-1]:g} s, at its end {end}, {found.method}, bands of "
                   f"{100 * found.level:g} %")  # fmt: skip


@display_of.register
def of_predicted(found: PredictedErrors) -> Display:
    """Signal-to-noise ratio and predicted errors."""
    grid = estimates(list(found.params.index), found.params["value"], found.params["se"])
    worst = float(found.response["gain_se"].max())
    return Display(
        f"signal-to-noise ratio {found.snr:.1f} dB; predicted standard error of the gain at most {plain(worst, 2)} %",
        (),
        grid,
    )


@display_of.register
def of_identification(found: Identification) -> Display:
    """The model, its fit, and the verdicts."""
    shown = of_model(found.model)
    fit = f"simulation fit {found.validation.fit:.1f} % ({found.validated_on})"
    form = () if found.form is None else (found.form.words,)
    words = (*form, found.argument, *found.verdicts)
    return Display(f"{shown.head}; {fit}", shown.facts, shown.table, words)


@display_of.register
def of_gains(gains: PiGains) -> Display:
    """Gains with their units, form and sample time; the rest as facts."""
    unit = _ratio(gains.unit_u, gains.unit_y)
    head = (
        f"Kp {plain(gains.kp)}{unit}, Ki {plain(gains.ki)}{unit} per second, {gains.form.replace('_', ' ')} form, "
        f"{gains.integration} integration at {gains.sample_time:g} s"
    )
    return Display(head, tuple(facts_of(gains)))


@display_of.register
def of_tuned(tuned: TunedPi) -> Display:
    """The verdict on the gains and its reasons; margins to the limits; the figures of the loop."""
    verdict = tuned.verdict
    table = TextTable(
        ("", "on the model", "limit", "left", "draws missing it"), tuple(margin.row for margin in tuned.margins)
    )
    return Display(f"{verdict.words}: {tuned.words}", tuple(facts_of(tuned.figures)), table, verdict.reasons)


@display_of.register
def of_loop(loop: Loop) -> Display:
    """Stability, largest pole, gains and plant."""
    state = "stable" if loop.stable else "UNSTABLE"
    head = f"{state}, largest pole {plain(loop.radius)}; {of_gains(loop.gains).head}"
    return Display(head, (("plant", of_model(loop.model).head),))


@display_of.register
def of_loop_trace(trace: LoopTrace) -> Display:
    """Duration, final output, range of the command, share of time at a limit."""
    low, high = plain(float(trace.command.min())), plain(float(trace.command.max()))
    head = (
        f"{len(trace.time)} samples over {trace.time[-1]:g} s, output ends at {plain(float(trace.output[-1]))} "
        f"{trace.unit_y}".rstrip()
        + f", command {low} to {high} {trace.unit_u}".rstrip()
    )
    return Display(head, (("at a limit", f"{trace.saturated.mean():.1%} of the time"),))


@display_of.register
def of_check(found: PiCheck) -> Display:
    """The verdict; one row per interpretation."""
    rows = tuple((reading.words, "yes" if reading.stable else "no", "yes" if reading.meets else "no")
                 for reading in found.interpretations)  # fmt: skip
    return Display(found.verdict, (), TextTable(("interpretation", "stable", "meets the specification"), rows))


@display_of.register
def of_map(found: FeasibleMap) -> Display:
    """Size of the map, and the share of gains that meet the specification."""
    share = float(found.feasible.mean())
    head = (
        f"{len(found.kp)} by {len(found.ki)} pairs of gains, Kp {plain(found.kp.min())} to {plain(found.kp.max())}, Ki "
        f"{plain(found.ki.min())} to {plain(found.ki.max())} per second; {share:.1%} meet {found.specification}"
    )
    return Display(head)


@display_of.register
def of_fit(fit: StepFit | DriveFit | ForceProcess) -> Display:
    """The verdict and the estimates in words; the parameters; the reasons of the verdict."""
    head = f"{fit.verdict.words}: {fit.words}"
    said = tuple(reason for reason in fit.verdict.reasons if reason not in fit.words)
    return Display(head, by_fields(fit).facts, _estimated(fit), (*said, *fit.notes))


def _estimated(fit: StepFit | DriveFit | ForceProcess) -> TextTable:
    params, bse = fit.params, fit.bse
    names = [str(name) for name in params.index]
    return estimates(names, params, [bse.get(n) for n in names])
