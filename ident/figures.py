"""Figures of identification: orders, simulation, Bode diagram, residuals, step responses, physical models."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from numpy.typing import NDArray

from ..core.display import plot, with_unit
from ..core.plotting import BLUE, GREY, ORANGE, NotebookFigure, new_axes
from .continuous import ContinuousModel
from .estimators.order_selection import OrderSearch
from .excitation.predicted_precision import PredictedErrors
from .identification import Identification
from .model import Model
from .physical_models.drive import DriveFit
from .physical_models.force_process import ForceProcess
from .physical_models.step_response import StepFit
from .responses.confidence_bands import ResponseBand, StepBand, response_band, step_band
from .responses.frequency import FrequencyResponse
from .validation.model_validation import Validation

Array = NDArray[np.float64]
LONGEST, SHORTEST = 2000, 20  # samples of a drawn step response
SETTLED = 0.002  # share of the slowest mode that is left at its end


@plot.register
def order_map(search: OrderSearch, ax: Axes | None = None) -> Axes:
    """A criterion over na and nb, above its smallest value; each cell at its best delay, which is written in it."""
    ax = new_axes(ax)
    name = search.criterion
    best = search.table.loc[search.table.groupby(["na", "nb"])[name].idxmin()]
    values = best.pivot_table(index="na", columns="nb", values=name)
    relative = name not in ("aic", "aicc", "bic")
    low = float(best[name].min())
    above = (values.to_numpy() - low) / (low if relative else 1.0)
    positive = above[above > 0]
    floor = float(positive.min()) if positive.size else 1.0
    norm = LogNorm(floor, max(float(np.nanmax(above)), 2 * floor))
    image = ax.imshow(np.maximum(above, floor), norm=norm, cmap="Blues_r", origin="lower", aspect="auto")
    unit = "times the smallest, less 1" if relative else "above the smallest"
    ax.figure.colorbar(image, ax=ax, label=f"{name} {unit}")
    ax.set_xticks(range(values.shape[1]), [str(v) for v in values.columns])
    ax.set_yticks(range(values.shape[0]), [str(v) for v in values.index])
    na, nb, nk = search.chosen
    across, up = ({int(v): k for k, v in enumerate(index)} for index in (values.columns, values.index))
    for row in best[["na", "nb", "nk"]].to_numpy(dtype=int):
        at = (across[row[1]], up[row[0]])
        dark = norm(max(above[at[1], at[0]], floor)) < 0.55
        ax.text(*at, str(row[2]), ha="center", va="center", fontsize=7, color="white" if dark else "black")
    ax.plot(across[nb], up[na], "s", ms=15, mfc="none", mec=ORANGE, mew=2)
    ax.set(xlabel="nb", ylabel="na")
    ax.set_title(f"chosen na {na}, nb {nb}, nk {nk}; number in a cell: best nk", fontsize=9)
    return ax


@plot.register
def simulated_fit(found: Validation, ax: Axes | None = None) -> Axes:
    """Measured output and the free run over it; stretches are set apart."""
    ax = new_axes(ax, 7.2, 3.6)
    name, unit = found.labels
    ends = [*found.starts[1:], len(found.y)]
    for k, (start, end) in enumerate(zip(found.starts, ends, strict=True)):
        part = slice(start, end)
        first = k == 0
        ax.plot(found.time[part], found.y[part], color=GREY, lw=1.6, label="measured" if first else None)
        ax.plot(found.time[part], found.yhat[part], color=BLUE, lw=1.0, label="simulated" if first else None)
        if not first:
            ax.axvline(found.time[start], color="black", lw=0.6, ls=":")
    ax.set(xlabel="time [s]", ylabel=f"{name} [{unit}]" if unit else name)
    ax.margins(x=0)
    ax.legend(loc="upper right", frameon=False, ncols=2, fontsize=8, bbox_to_anchor=(1, 1.12))
    ax.set_title(f"fit {found.fit:.1f} %, R² {found.rsquared:.3f}", fontsize=9, loc="left")
    return ax


@plot.register
def identification_figure(found: Identification, ax: Axes | None = None) -> Axes:
    """Measured and simulated output of the validation samples."""
    return simulated_fit(found.validation, ax)


def bode(
    model: Model, measured: FrequencyResponse | None = None, axes: tuple[Axes, Axes] | None = None
) -> tuple[Axes, Axes]:
    """Gain and phase of a model with its band, over the measured response; what was not excited is shaded."""
    upper, lower = axes or NotebookFigure(figsize=(6.0, 5.6), layout="constrained").subplots(2, 1, sharex=True)
    nyquist = 0.5 / model.sample_time
    band = model.band or (measured.band if measured is not None else None)
    low = (
        min(band[0] / 2, measured.frequency[0])
        if band and measured is not None
        else (band[0] / 2 if band else nyquist / 300)
    )
    f = np.geomspace(low, nyquist * 0.999, 300)
    _bode_model(model, f, upper, lower)
    if measured is not None:
        _bode_measured(measured, model, upper, lower)
    if band is not None:
        for ax in (upper, lower):
            for begin, end in ((f[0], band[0]), (band[1], f[-1])):
                ax.axvspan(begin, end, color=GREY, alpha=0.18, lw=0)
        lower.text(
            0.995, 0.03, "shaded: not excited", ha="right", fontsize=7, color="#555555", transform=lower.transAxes
        )
    unit = f" [{model.unit_y}/{model.unit_u}]" if model.unit_u and model.unit_y else ""
    upper.set(xscale="log", yscale="log", ylabel=f"gain{unit}", xlim=(f[0], f[-1]))
    lower.set(xscale="log", xlabel="frequency [Hz]", ylabel="phase [degrees]")
    return upper, lower


def _bode_model(model: Model, f: NDArray[np.float64], upper: Axes, lower: Axes) -> None:
    gain, phase = np.abs(model.response(f)), np.degrees(np.unwrap(np.angle(model.response(f))))
    if model.cov_params is not None:
        found = response_band(model, f)
        upper.fill_between(f, found.gain_low, found.gain_high, color=BLUE, alpha=0.25, lw=0, label="95 % band")
        lower.fill_between(f, found.phase_low, found.phase_high, color=BLUE, alpha=0.25, lw=0)
    upper.plot(f, gain, color=BLUE, lw=1.3, label=model.structure.replace("_", " "))
    lower.plot(f, phase, color=BLUE, lw=1.3)
    upper.set_ylim(gain.min() / 3, gain.max() * 3)
    lower.set_ylim(phase.min() - 60, phase.max() + 60)


def _bode_measured(measured: FrequencyResponse, model: Model, upper: Axes, lower: Axes) -> None:
    """Error bars where the response is known at all (standard error of the gain below one half)."""
    known = measured.gain_error < 0.5
    f, gain = measured.frequency[known], measured.gain[known]
    bars = np.abs(np.stack([gain - measured.gain_low[known], measured.gain_high[known] - gain]))
    style: dict[str, Any] = {"fmt": "o", "ms": 2.5, "color": ORANGE, "ecolor": ORANGE, "elinewidth": 0.7}
    upper.errorbar(f, gain, bars, label="measured, 95 %", **style)
    phase = np.degrees(np.unwrap(np.angle(model.response(f))))
    turn = np.degrees(np.angle(measured.response[known] / model.response(f)))  # on the model's branch
    lower.errorbar(f, phase + turn, (measured.phase_high - measured.phase)[known], **style)
    upper.legend(frameon=False, fontsize=8, loc="lower left")


def residual_correlations(found: Validation, axes: tuple[Axes, Axes] | None = None) -> tuple[Axes, Axes]:
    """Correlations of residuals with themselves, and with the input before and after, with their 95 % bands."""
    left, right = axes or NotebookFigure(figsize=(7.6, 3.2), layout="constrained").subplots(1, 2)
    _stems(left, found.whiteness.lags, found.whiteness.correlation, found.whiteness.band)
    joined = [
        np.concatenate([getattr(test, name) for test in (found.future_inputs, found.independence)])
        for name in ("lags", "correlation", "band")
    ]
    _stems(right, *joined)
    right.axvline(-0.5, color=GREY, lw=0.7, ls=":")
    for ax, test, text in ((left, found.whiteness, "with themselves"), (right, found.independence, "with the input")):
        ax.set_title(f"residuals {text}: p {test.pvalue:.2g}", fontsize=9)
        ax.set_xlabel("lag [samples]")
    left.set_ylabel("correlation")
    right.text(0.02, 0.96, "coming u", fontsize=7, color="#555555", va="top", transform=right.transAxes)
    right.text(0.98, 0.96, "past u", fontsize=7, color="#555555", va="top", ha="right", transform=right.transAxes)
    return left, right


def _stems(ax: Axes, lags: NDArray[np.intp], correlation: NDArray[np.float64], band: NDArray[np.float64]) -> None:
    ax.fill_between(lags, -band, band, color=GREY, alpha=0.25, lw=0, step="mid")
    beyond = np.abs(correlation) > band
    for chosen, colour in ((~beyond, BLUE), (beyond, ORANGE)):
        ax.vlines(lags[chosen], 0, correlation[chosen], color=colour, lw=1)
        ax.plot(lags[chosen], correlation[chosen], "o", ms=3, color=colour)
    ax.axhline(0, color="black", lw=0.6)
    top = 1.15 * max(float(np.abs(correlation).max()), float(band.max()), 1e-12)
    ax.set_ylim(-top, top)


@plot.register
def step_figure(model: Model, ax: Axes | None = None) -> Axes:
    """Response to a unit step of the input, from rest; with its band where the covariance is known."""
    ax = new_axes(ax)
    n = settling_samples(model.radius) + model.nk
    if model.cov_params is not None and model.stable:
        return step_band_figure(step_band(model, n * model.sample_time), ax, with_unit(model.output, model.unit_y))
    time = model.sample_time * np.arange(n + 1)
    ax.plot(time, model.simulate(np.ones(n + 1)), color=BLUE, drawstyle="steps-post")
    ax.set(xlabel="time [s]", ylabel=with_unit(model.output, model.unit_y), title=f"unit step of {model.input}")
    return ax


@plot.register
def step_band_figure(found: StepBand, ax: Axes | None = None, label: str = "response to a unit step") -> Axes:
    """The step within its band."""
    ax = new_axes(ax)
    ax.fill_between(found.time, found.low, found.high, color=BLUE, alpha=0.2, lw=0, label=f"{100 * found.level:g} %")
    ax.plot(found.time, found.step, color=BLUE)
    ax.set(xlabel="time [s]", ylabel=label, title="unit step of the input")
    ax.legend(frameon=False, fontsize=8)
    return ax


@plot.register
def continuous_figure(model: ContinuousModel, ax: Axes | None = None) -> Axes:
    """Gain over frequency, a decade to each side of its poles."""
    ax = new_axes(ax)
    corners = np.abs(model.poles[np.abs(model.poles) > 0]) / (2 * np.pi)
    low, high = (corners.min(), corners.max()) if corners.size else (0.1, 1.0)
    f = np.geomspace(low / 30, high * 10, 300)
    return gain_axes(ax, f, np.abs(model.response(f)), model.unit_y, model.unit_u)


@plot.register
def gain_figure(found: FrequencyResponse | ResponseBand, ax: Axes | None = None) -> Axes:
    """Gain within its band; frequencies that were not excited are grey."""
    ax = new_axes(ax)
    f, known = found.frequency, found.gain_error < 0.5
    inside = known & ~found.outside
    for mask, colour in ((inside, BLUE), (known & found.outside, GREY)):
        ax.vlines(f[mask], found.gain_low[mask], found.gain_high[mask], color=colour, lw=1)
        ax.plot(f[mask], found.gain[mask], "o", ms=3, color=colour)
    ax.set(xscale="log", yscale="log", xlabel="frequency [Hz]", ylabel="gain")
    ax.set_title(f"{100 * found.level:g} % intervals; grey: not excited", fontsize=9)
    return ax


@plot.register
def predicted_errors_figure(found: PredictedErrors, ax: Axes | None = None) -> Axes:
    """Standard error of the gain over frequency that is to be expected."""
    ax = new_axes(ax)
    ax.plot(found.response.index, found.response["gain_se"], color=BLUE)
    ax.set(xscale="log", yscale="log", xlabel="frequency [Hz]", ylabel="standard error of the gain [%]")
    return ax


def _both(ax: Axes, time: Array, measured: Array, model: Array, label: str) -> None:
    ax.plot(time, measured, color=BLUE, lw=1.2, label="measured" if label else None)
    ax.plot(time, model, color=ORANGE, lw=1.2, ls="--", label=label or None)


@plot.register
def step_fit_figure(fit: StepFit, ax: Axes | None = None) -> Axes:
    """Every stretch from its own start."""
    ax = new_axes(ax, 6.4, 3.6)
    for k, (run, fitted) in enumerate(zip(fit.runs, fit.fitted, strict=True)):
        _both(ax, run.time, run.y, fitted, f"order {fit.order} with delay" if k == 0 else "")
    ax.set(xlabel="time [s]", ylabel=with_unit(fit.output, fit.unit_y))
    ax.set_title(f"gain {fit.gain:.4g}, 63.2 % after {fit.time_to_63:.4g} s, fit {fit.fit:.1f} %", fontsize=9)
    ax.legend(frameon=False, fontsize=8)
    return ax


@plot.register
def drive_figure(fit: DriveFit, ax: Axes | None = None) -> Axes:
    """Velocity measured, and simulated from the force alone."""
    ax = new_axes(ax, 6.4, 3.6)
    simulated, percent = fit.own_run
    time = fit.motion.sample_time * np.arange(len(simulated), dtype=np.float64)
    _both(ax, time, fit.motion.v, simulated, "from the force alone")
    ax.set(xlabel="time [s]", ylabel=f"velocity [{fit.motion.speed_unit}]")
    ax.set_title(
        f"M {fit.M:.4g}, Fv {fit.Fv:.4g}, Fc {fit.Fc:.3g}, offset {fit.offset:.3g}, fit {percent:.1f} %", fontsize=9
    )
    ax.legend(frameon=False, fontsize=8)
    return ax


@plot.register
def force_process_figure(fit: ForceProcess, ax: Axes | None = None) -> Axes:
    """Force measured, and simulated from the command alone."""
    ax = new_axes(ax, 6.4, 3.6)
    _both(ax, fit.time, fit.measured, fit.simulated, "from the command alone")
    ax.set(xlabel="time [s]", ylabel=with_unit(fit.output, fit.unit_y))
    poles = " and ".join(f"{p.real:.4g}" if p.imag == 0 else f"{p:.4g}" for p in fit.poles)
    ax.set_title(f"poles {poles} rad/s, fit {fit.fit:.1f} %", fontsize=9)
    ax.legend(frameon=False, fontsize=8)
    return ax


def gain_axes(ax: Axes, f: NDArray[np.float64], gain: NDArray[np.float64], above: str, below: str) -> Axes:
    """Gain over frequency on logarithmic axes, with its unit above/below."""
    ax.plot(f, gain, color=BLUE)
    ax.set(xscale="log", yscale="log", xlabel="frequency [Hz]")
    ax.set_ylabel(f"gain [{above}/{below}]" if above and below else "gain")
    return ax


def settling_samples(radius: float) -> int:
    """Samples until a mode of this pole radius has decayed to 0.2 %, from 20 to 2000."""
    if radius > 0.999:
        return LONGEST
    return int(np.clip(np.log(SETTLED) / np.log(max(radius, 1e-3)), SHORTEST, LONGEST))
