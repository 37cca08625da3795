"""The drive over frequency, and the step of its loop, as panels."""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from ...parameters import DynamicsSection
from ...parameters.checks.loop_figures import ClosedLoop
from ..content.parts import Figure
from .svg_panel import LINE, SOFT, TESTED, Drawing, Panel, decades, even

Array = NDArray[np.float64]

FREQUENCIES = 80
BELOW = 10.0  # times below the excited band, or 200 below Nyquist, where a frequency axis begins
STILL = 1e-3  # what the slowest pole has died down to where a step ends
LONGEST = 5000  # samples of a step
DRAWN = 300  # of which are drawn
SETTLED = 0.02


def bode(figure: Figure, model: DynamicsSection) -> Iterator[Drawing]:
    """Gain and phase of the model up to half the sampling rate, the excited band marked."""
    nyquist = 0.5 / model.sample_time
    least = model.band[0] / BELOW if model.band and model.band[0] > 0 else nyquist / (20 * BELOW)
    f = np.geomspace(min(least, nyquist / BELOW), 0.999 * nyquist, FREQUENCIES)
    with np.errstate(all="ignore"):
        G = model.response(f)
        f, G = f[np.isfinite(G) & (G != 0)], G[np.isfinite(G) & (G != 0)]
    if not len(f):
        return
    gain, phase = np.log10(np.abs(G)), np.degrees(np.unwrap(np.angle(G)))
    across = decades(float(np.log10(f[0])), float(np.log10(nyquist)), "frequency, Hz")
    unit = f"{model.unit_y or 'output'}/{model.unit_u or 'input'}"
    room = 0.08 * float(np.ptp(gain)) + 0.05
    for name, values, up in (
        ("gain", gain, decades(float(gain.min()) - room, float(gain.max()) + room, f"gain, {unit}")),
        ("phase", phase, even(float(phase.min()) - 10, float(phase.max()) + 10, "phase, degrees")),
    ):
        title = f"{name.capitalize()} over frequency"
        yield Drawing(title, figure.alternative, across, up, _over_frequency(np.log10(f), values, model.band))


def _over_frequency(f: Array, values: Array, band: tuple[float, float] | None) -> Callable[[Panel], None]:
    def draw(panel: Panel) -> None:
        if band is not None and band[0] > 0:
            low, high = np.log10(band)
            panel.ax.axvspan(low, high, color=TESTED, lw=0)
            panel.above((low + high) / 2, "excited")
        panel.ax.plot(f, values, color=LINE, lw=2)

    return draw


def step(figure: Figure, loop: ClosedLoop) -> Iterator[Drawing]:
    """Output of the loop after a unit step of the reference, from rest, with the lines it settles between."""
    radius = loop.radius
    if not radius < 1:
        return
    n = int(np.clip(np.log(STILL) / np.log(max(radius, 1e-3)), 30, LONGEST))
    y = loop.run(np.convolve(np.convolve(loop.b, loop.pn), loop.hd), np.ones(n))
    time = np.arange(n) * loop.sample_time
    every = slice(None, None, -(-n // DRAWN))
    across = even(0.0, float(time[-1]), "time, s")
    up = even(min(0.0, float(y.min())), 1.06 * max(1.0, float(y.max())), "output per unit of reference")

    def draw(panel: Panel) -> None:
        panel.ax.axhspan(1 - SETTLED, 1 + SETTLED, color=TESTED, lw=0)
        panel.ax.axhline(1.0, color=SOFT, lw=0.8, ls=(0, (3, 3)))
        panel.ax.plot(time[every], y[every], color=LINE, lw=2)

    yield Drawing("Step of the reference", figure.alternative, across, up, draw)
