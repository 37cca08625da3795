"""Pictures of responses: a step of a model or a loop, gain over frequency, predicted errors."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from ..core.display import with_unit
from ..core.plotting import BLUE, GREY, ORANGE, new_axes, whiskers

if TYPE_CHECKING:
    from .excite.predicted_precision import PredictedErrors
    from .judging.bands import ResponseBand
    from .judging.frequency import FrequencyResponse
    from .judging.step_bands import StepBand
    from .machines.continuous import ContinuousModel
    from .model import Model
    from .pi.check import PiCheck
    from .pi.gains import PiGains
    from .pi.loop import Loop

LONG, SHORT, SETTLED = (
    2000,
    20,
    0.002,
)  # samples of a step at most and at least; radius to the power of how many is over


def step_picture(model: "Model", ax: Axes | None = None) -> Axes:
    """Response to a unit step of the input, from rest; with its band where the covariance is known."""
    ax = new_axes(ax)
    radius = min(model.radius, 1.0)
    n = LONG if radius > 0.999 else int(np.clip(np.log(SETTLED) / np.log(max(radius, 1e-3)), SHORT, LONG))
    n += model.nk
    if model.cov_params is not None and model.stable:
        from .judging.step_bands import step_band

        return step_band_picture(step_band(model, n * model.sample_time), ax, with_unit(model.output, model.unit_y))
    time = model.sample_time * np.arange(n + 1)
    ax.plot(time, model.simulate(np.ones(n + 1)), color=BLUE, drawstyle="steps-post")
    ax.set(xlabel="time [s]", ylabel=with_unit(model.output, model.unit_y), title=f"unit step of {model.input}")
    return ax


def step_band_picture(found: "StepBand", ax: Axes | None = None, label: str = "response to a unit step") -> Axes:
    """The step within its band."""
    ax = new_axes(ax)
    ax.fill_between(found.time, found.low, found.high, color=BLUE, alpha=0.2, lw=0, label=f"{100 * found.level:g} %")
    ax.plot(found.time, found.step, color=BLUE)
    ax.set(xlabel="time [s]", ylabel=label, title="unit step of the input")
    ax.legend(frameon=False, fontsize=8)
    return ax


def continuous_picture(model: "ContinuousModel", ax: Axes | None = None) -> Axes:
    """Gain over frequency, a decade to each side of its poles."""
    ax = new_axes(ax)
    corners = np.abs(model.poles[np.abs(model.poles) > 0]) / (2 * np.pi)
    low, high = (corners.min(), corners.max()) if corners.size else (0.1, 1.0)
    f = np.geomspace(low / 30, high * 10, 300)
    return _gain(ax, f, np.abs(model.response(f)), model.unit_y, model.unit_u)


def gain_picture(found: "FrequencyResponse | ResponseBand", ax: Axes | None = None) -> Axes:
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


def gains_picture(gains: "PiGains", ax: Axes | None = None) -> Axes:
    """Gain of the controller over frequency: the sum leads at low ones, Kp remains at high ones."""
    (num, den), dt = gains.transfer_function, gains.sample_time
    f = np.geomspace(0.5e-4 / dt, 0.499 / dt, 300)
    z = np.exp(-2j * np.pi * f * dt)
    gain = np.abs(np.polyval(np.asarray(num)[::-1], z) / np.polyval(np.asarray(den)[::-1], z))
    return _gain(new_axes(ax), f, gain, gains.unit_u, gains.unit_y)


def loop_picture(loop: "Loop", ax: Axes | None = None) -> Axes:
    """Output after a unit step of the reference."""
    ax = new_axes(ax)
    radius = min(loop.radius, 1.0)
    n = LONG if radius > 0.999 else int(np.clip(np.log(SETTLED) / np.log(max(radius, 1e-3)), SHORT, LONG))
    time = loop.model.sample_time * np.arange(n)
    ax.plot(time, loop.step(n), color=BLUE, drawstyle="steps-post")
    ax.axhline(1, color=GREY, lw=0.8, ls="--")
    ax.set(xlabel="time [s]", ylabel=f"{loop.model.output}, unit step of the reference")
    return ax


def errors_picture(found: "PredictedErrors", ax: Axes | None = None) -> Axes:
    """Standard error of the gain over frequency that is to be expected."""
    ax = new_axes(ax)
    ax.plot(found.response.index, found.response["gain_se"], color=BLUE)
    ax.set(xscale="log", yscale="log", xlabel="frequency [Hz]", ylabel="standard error of the gain [%]")
    return ax


def check_picture(found: "PiCheck", ax: Axes | None = None) -> Axes:
    """In which scalings of the command each reading is stable, and meets the specification."""
    ax = whiskers({reading.words: (1.0, np.nan, np.nan) for reading in found.readings}, ax)
    for line in ax.get_lines():
        line.set_visible(False)
    for at, reading in enumerate(found.readings):
        for intervals, colour, width in ((reading.stable, BLUE, 3.0), (reading.meets, ORANGE, 6.0)):
            for low, high in intervals:
                ax.plot([low, high], [at, at], "|-", color=colour, lw=width, solid_capstyle="butt")
    ax.set(xscale="log", xlabel=f"scaling, {found.command_unit or '1'} per {found.input_unit or '1'}")
    ax.set_title("blue: stable, orange: meets what was asked", fontsize=9)
    return ax


def _gain(ax: Axes, f: NDArray[np.float64], gain: NDArray[np.float64], above: str, below: str) -> Axes:
    ax.plot(f, gain, color=BLUE)
    ax.set(xscale="log", yscale="log", xlabel="frequency [Hz]")
    ax.set_ylabel(f"gain [{above}/{below}]" if above and below else "gain")
    return ax
