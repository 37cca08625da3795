"""Figures of identification: orders, simulation, Bode diagram, residuals, step responses, poles and zeros."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.patches import Circle, Rectangle
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ..core.arrays import Array, Ints
from ..core.display import plot
from ..core.figure_style import BLUE, FILL, GREY, LIGHT, LINE, ORANGE, SEQUENTIAL, SMALL, THICK, THIN, new_axes
from ..core.plotting import NotebookFigure
from ..core.rounding import with_unit
from .continuous import ContinuousModel
from .draws import drawn_models
from .estimators.order_selection import OrderSearch
from .excitation.predicted_precision import PredictedErrors
from .identification import Identification
from .model import Model
from .responses.confidence_bands import ResponseBand, StepBand, response_band, step_band
from .responses.frequency import FrequencyResponse
from .validation.model_validation import Validation

LONGEST, SHORTEST = 2000, 20  # samples of a drawn step response
FARTHEST = 10_000  # samples: of a response that has not settled before
NAMES = {"box_jenkins": "Box-Jenkins model", "output_error": "output-error model", "arx": "ARX model"}
DRAWN = 100  # models whose poles and zeros are drawn
EDGE = 1.6  # of the picture of the z plane
CELLS = 14  # delays in the chart of structures that have space for numbers
RANKED = 10  # candidates whose criterion is drawn
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
    image = ax.imshow(np.maximum(above, floor), norm=norm, cmap=f"{SEQUENTIAL}_r", origin="lower", aspect="auto")
    ax.grid(visible=False)
    unit = "times the smallest, less 1" if relative else "above the smallest"
    ax.figure.colorbar(image, ax=ax, label=f"{name} {unit}")
    ax.set_xticks(range(values.shape[1]), [str(v) for v in values.columns])
    ax.set_yticks(range(values.shape[0]), [str(v) for v in values.index])
    na, nb, nk = search.chosen
    across, up = ({int(v): k for k, v in enumerate(index)} for index in (values.columns, values.index))
    for row in best[["na", "nb", "nk"]].to_numpy(dtype=int):
        at = (across[row[1]], up[row[0]])
        dark = norm(max(above[at[1], at[0]], floor)) < 0.55
        ax.text(*at, str(row[2]), ha="center", va="center", fontsize=SMALL, color="white" if dark else "black")
    ax.plot(across[nb], up[na], "s", ms=15, mfc="none", mec=ORANGE, mew=2)
    ax.set(xlabel="nb", ylabel="na")
    ax.set_title(f"chosen na {na}, nb {nb}, nk {nk}; number in a cell: best nk")
    return ax


@plot.register
def simulated_fit(found: Validation, ax: Axes | None = None) -> Axes:
    """Measured output and the free run over it; stretches are set apart."""
    ax = new_axes(ax, 7.2, 3.6)
    for k, part in enumerate(_stretches(found)):
        labels = ("measured", "simulated") if k == 0 else (None, None)
        ax.plot(found.time[part], found.y[part], color=GREY, lw=THICK, label=labels[0])
        ax.plot(found.time[part], found.yhat[part], color=BLUE, lw=THIN, label=labels[1])
        if k:
            ax.axvline(found.time[part.start], color="black", lw=THIN, ls=":")
    ax.set(xlabel="time [s]", ylabel=with_unit(*found.labels))
    ax.margins(x=0)
    ax.legend(loc="upper right", ncols=2, bbox_to_anchor=(1, 1.12))
    ax.set_title(f"fit {found.fit:.1f} %, R² {found.rsquared:.3f}", loc="left")
    return ax


def _stretches(found: Validation) -> list[slice]:
    return [slice(start, end) for start, end in zip(found.starts, [*found.starts[1:], len(found.y)], strict=True)]


def simulation_and_residuals(found: Validation, where: str = "") -> tuple[Axes, Axes]:
    """Measured and simulated output of a validation, and below it their difference, on the same time axis.

    ``where`` names the samples.
    """
    grid: dict[str, Any] = {"height_ratios": (2.2, 1)}
    upper, lower = NotebookFigure(figsize=(7.2, 4.8), layout="constrained").subplots(
        2, 1, sharex=True, gridspec_kw=grid
    )
    simulated_fit(found, upper).set_xlabel("")
    left, unit = found.y - found.yhat, found.labels[1]
    for part in _stretches(found):
        lower.plot(found.time[part], left[part], color=ORANGE, lw=THIN)
    spread = 2 * float(np.std(left))
    lower.axhspan(-spread, spread, color=GREY, alpha=0.2, lw=0, label=f"± 2 sd, {spread:.2g} {unit}".rstrip())
    lower.axhline(0, color="black", lw=THIN)
    lower.set(xlabel=f"time [s]{', ' if where else ''}{where}", ylabel=with_unit("residual", unit))
    lower.legend(loc="upper right")
    return upper, lower


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
    low = band[0] / 2 if band else nyquist / 300
    if band and measured is not None:
        low = min(low, measured.frequency[0])
    f = np.geomspace(low, nyquist * 0.999, 300)
    _bode_model(model, f, upper, lower)
    if measured is not None:
        _bode_measured(measured, model, upper, lower)
    if band is not None:
        for ax in (upper, lower):
            for begin, end in ((f[0], band[0]), (band[1], f[-1])):
                ax.axvspan(begin, end, color=GREY, alpha=0.18, lw=0)
        words = f"excited: {band[0]:.3g} to {band[1]:.3g} Hz; shaded: not excited, the model extrapolates"
        lower.text(0.995, 0.03, words, ha="right", fontsize=SMALL, color=GREY, transform=lower.transAxes)
    unit = f" [{model.unit_y}/{model.unit_u}]" if model.unit_u and model.unit_y else ""
    upper.set(xscale="log", yscale="log", ylabel=f"gain{unit}", xlim=(f[0], f[-1]))
    lower.set(xscale="log", xlabel="frequency [Hz]", ylabel="phase [degrees]")
    for axis in (lower.xaxis, *([upper.yaxis] if upper.get_ylim()[1] < 200 * upper.get_ylim()[0] else [])):
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter(FuncFormatter(_plain))
        axis.set_minor_formatter(NullFormatter())
    return upper, lower


def _plain(value: float, _: int) -> str:
    """A tick as 0.1 instead of a power of ten."""
    return f"{value:g}"


def _bode_model(model: Model, f: Array, upper: Axes, lower: Axes) -> None:
    gain, phase = np.abs(model.response(f)), np.degrees(np.unwrap(np.angle(model.response(f))))
    if model.cov_params is not None:
        found = response_band(model, f)
        upper.fill_between(f, found.gain_low, found.gain_high, color=BLUE, alpha=0.25, lw=0, label="95 % band")
        lower.fill_between(f, found.phase_low, found.phase_high, color=BLUE, alpha=0.25, lw=0)
    upper.plot(f, gain, color=BLUE, lw=LINE, label=NAMES.get(model.structure, "model"))
    lower.plot(f, phase, color=BLUE, lw=LINE)
    upper.set_ylim(gain.min() / 3, gain.max() * 3)
    lower.set_ylim(phase.min() - 60, phase.max() + 60)


def _bode_measured(measured: FrequencyResponse, model: Model, upper: Axes, lower: Axes) -> None:
    """Error bars where the response is known at all (standard error of the gain below one half)."""
    known = measured.gain_error < 0.5
    f, gain = measured.frequency[known], measured.gain[known]
    bars = np.abs(np.stack([gain - measured.gain_low[known], measured.gain_high[known] - gain]))
    style: dict[str, Any] = {"fmt": "o", "ms": 2.5, "color": ORANGE, "ecolor": ORANGE, "elinewidth": THIN}
    upper.errorbar(f, gain, bars, label=f"measured, 95 %, resolution {measured.resolution:.2g} Hz", **style)
    phase = np.degrees(np.unwrap(np.angle(model.response(f))))
    turn = np.degrees(np.angle(measured.response[known] / model.response(f)))  # on the model's branch
    lower.errorbar(f, phase + turn, (measured.phase_high - measured.phase)[known], **style)
    upper.legend(loc="lower left")


def residual_correlations(found: Validation, axes: tuple[Axes, Axes] | None = None) -> tuple[Axes, Axes]:
    """Correlations of residuals with themselves, and with the input before and after, with their 95 % bands."""
    left, right = axes or NotebookFigure(figsize=(7.6, 3.2), layout="constrained").subplots(1, 2)
    _stems(left, found.whiteness.lags, found.whiteness.correlation, found.whiteness.band)
    joined = [
        np.concatenate([getattr(test, name) for test in (found.future_inputs, found.independence)])
        for name in ("lags", "correlation", "band")
    ]
    _stems(right, *joined)
    right.axvline(-0.5, color=GREY, lw=THIN, ls=":")
    for ax, test, text in ((left, found.whiteness, "with themselves"), (right, found.independence, "with the input")):
        ax.set(title=f"residuals {text}: p {test.pvalue:.2g}", xlabel="lag [samples]")
    left.set_ylabel("correlation")
    right.text(0.02, 0.96, "coming u", fontsize=SMALL, color=GREY, va="top", transform=right.transAxes)
    right.text(0.98, 0.96, "past u", fontsize=SMALL, color=GREY, va="top", ha="right", transform=right.transAxes)
    return left, right


def _stems(ax: Axes, lags: Ints, correlation: Array, band: Array) -> None:
    ax.fill_between(lags, -band, band, color=GREY, alpha=0.25, lw=0, step="mid")
    beyond = np.abs(correlation) > band
    for chosen, colour in ((~beyond, BLUE), (beyond, ORANGE)):
        ax.vlines(lags[chosen], 0, correlation[chosen], color=colour, lw=THIN)
        ax.plot(lags[chosen], correlation[chosen], "o", ms=3, color=colour)
    ax.axhline(0, color="black", lw=THIN)
    top = 1.15 * max(float(np.abs(correlation).max()), float(band.max()), 1e-12)
    ax.set_ylim(-top, top)


@plot.register
def step_figure(model: Model, ax: Axes | None = None) -> Axes:
    """Response to a unit step of the input, from rest, until it has settled; with its band where it is known."""
    ax = new_axes(ax)
    n = answer_samples(model)
    label = with_unit(model.output, model.unit_y)
    if model.cov_params is not None and (model.stable or model.integrating):
        step_band_figure(step_band(model, n * model.sample_time), ax, label)
    else:
        time = model.sample_time * np.arange(n + 1)
        ax.plot(time, model.simulate(np.ones(n + 1)), color=BLUE, drawstyle="steps-post")
        ax.set(xlabel="time [s]", ylabel=label)
    ax.set_title(f"step of {model.input} by 1 {model.unit_u}".rstrip())
    return ax


def answer_samples(model: Model) -> int:
    """Samples until the response to a step has settled within 1 %, half as long again, at least 20.

    An integrating model has settled when its slope has. The response is drawn no longer than the record was.
    """
    n, most = SHORTEST, min(FARTHEST, max(model.n or FARTHEST, SHORTEST))
    while n < most:
        n *= 2
        y = model.simulate(np.ones(n))
        y = np.diff(y) if model.integrating else y
        left = np.abs(y - y[-1]) > 0.01 * np.ptp(y)
        last = int(np.flatnonzero(left)[-1]) if left.any() else 0
        if not np.isfinite(y[-1]):
            return SHORTEST
        if last < n / 4:
            return min(max(int(1.5 * last) + 2, SHORTEST), most)
    return most


def poles_and_zeros(model: Model, ax: Axes | None = None) -> Axes:
    """Poles and zeros in the z plane with those of draws of the model, the unit circle, and the excited band."""
    ax = new_axes(ax)
    ax.add_patch(Circle((0, 0), 1, fill=False, color="black", lw=THIN))
    if model.band is not None:
        low, high = (2 * np.pi * model.sample_time * f for f in model.band)
        for sign in (1, -1):
            turn = np.exp(1j * sign * np.linspace(low, high, 60))
            ax.plot(turn.real, turn.imag, color=BLUE, lw=THICK, alpha=0.35, label="excited band" if sign > 0 else None)
    drawn = drawn_models(model, DRAWN, 1, least=0.0).models if model.cov_params is not None else ()
    far: list[float] = []
    for name, colour, mark in (("poles", BLUE, "x"), ("zeros", ORANGE, "o")):
        cloud = np.concatenate([getattr(one, name) for one in drawn]) if drawn else np.empty(0)
        ax.plot(cloud.real, cloud.imag, ".", color=colour, ms=2, alpha=0.35, zorder=1)
        at = getattr(model, name)
        at = at[np.abs(at) > 1e-3]  # those at 0 are the delay
        ax.plot(at.real, at.imag, mark, color=colour, ms=8, mew=1.8, mfc="none", label=name, ls="")
        far += [float(z.real) for z in at if abs(z) > EDGE and z.imag >= 0]
    if far:
        words = ", ".join(f"{x:.3g}" for x in far)
        ax.text(0.02, 0.02, f"zeros outside the picture, real part: {words}", fontsize=SMALL, transform=ax.transAxes)
    ax.axhline(0, color=GREY, lw=THIN, zorder=0)
    ax.axvline(0, color=GREY, lw=THIN, zorder=0)
    ax.set(xlabel="real part of z", ylabel="imaginary part of z", xlim=(-EDGE, EDGE), ylim=(-EDGE, EDGE))
    ax.set_aspect("equal")
    ax.legend(loc="upper right")
    ax.set_title(f"poles and zeros{f'; dots: {len(drawn)} draws of the model' if drawn else ''}")
    return ax


def structure_chart(found: Identification, axes: tuple[Axes, Axes] | None = None) -> tuple[Axes, Axes]:
    """Simulation fit of the candidates over order and delay, and the best ones by their criterion with their weights.

    The candidate that was chosen is outlined and stands first.
    """
    widths: dict[str, Any] = {"width_ratios": (1.25, 1)}
    left, right = axes or NotebookFigure(figsize=(9.6, 3.9), layout="constrained").subplots(1, 2, gridspec_kw=widths)
    table, chosen = found.tried, found.tried.iloc[0]
    table = table[table["form"] == ""]
    best = table.loc[table.groupby(["na", "nk"])["loss"].idxmin()]
    grid = best.pivot_table(index="na", columns="nk", values="loss")
    grid = grid.reindex(columns=range(int(grid.columns.min()), int(grid.columns.max()) + 1))
    error = np.sqrt(grid.to_numpy() / float(table["loss"].min()))
    norm = LogNorm(1.0, float(np.clip(np.nanmax(error), 2.0, 100.0)))
    left.set_facecolor(LIGHT.rule)
    left.grid(visible=False)
    image = left.imshow(error, norm=norm, cmap=f"{SEQUENTIAL}_r", origin="lower", aspect="auto")
    scale = left.figure.colorbar(image, ax=left, label="simulation error / smallest", ticks=[1, 2, 5, 10, 20, 50, 100])
    scale.formatter = FuncFormatter(_plain)
    scale.minorticks_off()
    _fits(left, grid, best, norm, float(table["loss"].min()))
    if not chosen["form"]:
        row, column = list(grid.index).index(chosen["na"]), list(grid.columns).index(chosen["nk"])
        left.add_patch(Rectangle((column - 0.5, row - 0.5), 1, 1, fill=False, ec=ORANGE, lw=THICK))
    left.set(xlabel="delay nk [samples]", ylabel="order na")
    end = f"chosen: {chosen['form']}" if chosen["form"] else "outlined: chosen"
    what = "simulation fit [%]" if len(grid.columns) <= CELLS else "simulation error"
    what += f" without the {found.search.without}" if found.search.without else ""
    left.set_title(f"{what}, best nb; grey: not tried; {end}")
    _ranking(right, found)
    return left, right


def _fits(ax: Axes, grid: Any, best: Any, norm: LogNorm, least: float) -> None:  # noqa: ANN401
    """Ticks of the chart, and the fit in each cell where there is space."""
    rows, columns = list(grid.index), list(grid.columns)
    step = -(-len(columns) // CELLS)
    ax.set_xticks(range(0, len(columns), step), [str(v) for v in columns[::step]])
    ax.set_yticks(range(len(rows)), [str(v) for v in rows])
    for na, nk, loss, fit in best[["na", "nk", "loss", "fit"]].to_numpy():
        if len(columns) <= CELLS:
            dark = float(norm(np.sqrt(loss / least))) < 0.5
            at = columns.index(int(nk)), rows.index(int(na))
            ax.text(*at, f"{fit:.1f}", ha="center", va="center", fontsize=SMALL, color="white" if dark else "black")


def _ranking(ax: Axes, found: Identification) -> None:
    """Bars of the criterion above the smallest for the best candidates, with their weights."""
    rows = found.tried.head(RANKED)
    above = (rows["bic"] - found.tried["bic"].min()).to_numpy(dtype=np.float64)
    ax.barh(range(len(rows)), above, color=[ORANGE, *[BLUE] * (len(rows) - 1)], height=0.6)
    for k, (value, (_, row)) in enumerate(zip(above, rows.iterrows(), strict=True)):
        weight = float(row.get("weight", 0.0))
        share = f"weight {weight:.2g}" if weight else "chosen" if k == 0 else ""
        ax.text(value, k, f" {share}", va="center", fontsize=SMALL)
    ax.set_yticks(range(len(rows)), [_candidate(row) for _, row in rows.iterrows()], fontsize=SMALL)
    ax.invert_yaxis()
    ax.set_xlim(0, 1.3 * max(float(above.max()), 1.0))
    ax.set_xlabel("criterion (BIC) above the smallest")
    ax.set_title("best candidates")


def _candidate(row: Any) -> str:  # noqa: ANN401
    """Name of a candidate: a continuous form, or orders and delay."""
    if form := row.get("form", ""):
        return str(form)
    orders = f"na {row.na:.0f}, nb {row.nb:.0f}, nk {row.nk:.0f}"
    return f"{orders}, ARX" if row.get("structure", "") == "arx" else orders


@plot.register
def step_band_figure(found: StepBand, ax: Axes | None = None, label: str = "response to a unit step") -> Axes:
    """The step within its band."""
    ax = new_axes(ax)
    band = f"{100 * found.level:g} % band"
    ax.fill_between(found.time, found.low, found.high, color=BLUE, alpha=FILL, lw=0, label=band)
    ax.plot(found.time, found.step, color=BLUE)
    ax.axhline(0, color=GREY, lw=THIN, zorder=0)
    ax.margins(x=0)
    ax.set(xlabel="time [s]", ylabel=label)
    ax.set_title("unit step of the input")
    ax.legend()
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
        ax.vlines(f[mask], found.gain_low[mask], found.gain_high[mask], color=colour, lw=THIN)
        ax.plot(f[mask], found.gain[mask], "o", ms=3, color=colour)
    ax.set(xscale="log", yscale="log", xlabel="frequency [Hz]", ylabel="gain")
    ax.set_title(f"{100 * found.level:g} % intervals; grey: not excited")
    return ax


@plot.register
def predicted_errors_figure(found: PredictedErrors, ax: Axes | None = None) -> Axes:
    """Standard error of the gain over frequency that is to be expected."""
    ax = new_axes(ax)
    ax.plot(found.response.index, found.response["gain_se"], color=BLUE)
    ax.set(xscale="log", yscale="log", xlabel="frequency [Hz]", ylabel="standard error of the gain [%]")
    return ax


def gain_axes(ax: Axes, f: Array, gain: Array, above: str, below: str) -> Axes:
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
