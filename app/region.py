"""The region of speed and feed within limits that are moved by sliders, as a picture and its best pair."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..cards.content.design import middle
from ..cards.forms.svg_panel import LIMIT, LINE, TESTED, Margins, PanelAxis, PanelCanvas, PanelDrawing, svg
from ..controllers.region.limits import CANDIDATES, limited
from ..controllers.region.log_planes import ratio
from ..controllers.region.surfaces import ResponseBound
from ..controllers.region.visible import VisibleRegion, visible_region
from ..core.errors import UsageError
from ..datasets.vocabulary import ROLES
from ..parameters import ParameterFile, read
from ..parameters.sections.load_line import LimitsSection

POINTS: Final = 81  # of the grid along each axis
STEPS: Final = 200  # of a slider
MARGIN: Final = 0.05  # of an axis


@dataclass(frozen=True, slots=True)
class Slider:
    """A limit or setting that is moved.

    Attributes
    ----------
    name : str
        Symbol of the response, or d and t.
    label, unit : str
    low, high, step, value : str
        Numbers as texts.
    """

    name: str
    label: str
    unit: str
    low: str
    high: str
    step: str
    value: str


def sliders(folder: Path, params: str) -> tuple[Slider, ...]:
    """Sliders of the limits of responses and of depth and time; none where the laws have no speed and feed.

    Raises
    ------
    ParameterError
        The file cannot be read.
    """
    pf = read(folder / params)
    laws = [law for law in pf.laws.values() if {"V", "f"} <= {one.symbol for one in law.factors}]
    if not laws:
        return ()
    made = [_of_response(pf, law) for law in laws if _kind(law.response)]
    others = {one.symbol: one for law in laws for one in law.factors if one.symbol in ("d", "t")}
    return (*made, *(_slider(s, ROLES[s].quantity, f.unit, f.low, f.high, middle(laws[0]).get(s, f.low))
                     for s, f in sorted(others.items())))  # fmt: skip


def _of_response(pf: ParameterFile, law: Any) -> Slider:  # noqa: ANN401  a section of a law
    """The slider of a limit, at that of the file, else at 0.8 of the largest value of the law within the tests."""
    highest = float(np.max(_values(law)))
    set_now = _limits(pf).get(law.response)
    value = set_now if set_now is not None else 0.8 * highest
    label = f"{law.quantity}{' of the cut' if law.of_cut else ''} at most"
    return _slider(law.response, label, law.unit, highest / 10, max(1.3 * highest, value), value)


def _values(law: Any) -> np.ndarray:  # noqa: ANN401
    """Values of a law at the ends of its tested ranges."""
    ends = [[one.low, one.high] for one in law.factors]
    grid = np.meshgrid(*ends)
    return np.asarray(law.values({one.symbol: g for one, g in zip(law.factors, grid, strict=True)}))


def _bounds(pf: ParameterFile) -> tuple[list[ResponseBound], list[str]]:
    """Limits of the file on responses with a law, in the units of the laws, and a sentence on each other one."""
    limits, found, left = pf.limits or LimitsSection(), list[ResponseBound](), list[str]()
    alone = [{name: bound} for name in CANDIDATES if (bound := getattr(limits, name)) is not None]
    alone += [{"responses": {symbol: ends}} for symbol, ends in limits.responses.items()]
    for one in alone:
        try:
            for symbol, side, value, unit in limited(pf, LimitsSection.model_validate(one)):
                own = pf.laws[symbol].unit
                found.append(ResponseBound(symbol, side, value * ratio(unit, own), own))
        except UsageError as error:
            left.append(f"NOT APPLIED: {error}")
    return found, left


def _limits(pf: ParameterFile) -> dict[str, float]:
    """Upper limits of the file by symbol, in the units of the laws."""
    most = sorted((one for one in _bounds(pf)[0] if one.side == "most"), key=lambda one: -one.value)
    return {one.symbol: one.value for one in most}


def _limits_with(pf: ParameterFile, highest: Mapping[str, float]) -> dict[str, Any]:
    """The limits of the file on responses, with these upper ones by symbol; that of the wear names its law."""
    responses: dict[str, dict[str, Any]] = {
        name: {"high": value, "unit": pf.laws[name].unit} for name, value in highest.items()
    }
    for symbol, side, value, _ in _bounds(pf)[0]:
        if side == "least":
            responses.setdefault(symbol, {"unit": pf.laws[symbol].unit})["low"] = value
    limits: dict[str, Any] = {"power": None, "force": None, "wear": None, "responses": responses}
    wear = None if pf.limits is None or pf.limits.wear is None else pf.limits.wear.of
    if wear is not None and wear in highest:
        limits["wear"] = {"value": highest[wear], "unit": pf.laws[wear].unit, "of": wear}
    return limits


def _kind(symbol: str) -> str:
    """Name of the limit of a response: power, force or wear; empty where it has none."""
    role = ROLES.get(symbol)
    if role is None:
        return ""
    return "wear" if role.kind == "wear" else {"N": "force", "kW": "power"}.get(role.unit, "")


def _slider(name: str, label: str, unit: str, low: float, high: float, value: float) -> Slider:
    step = 10.0 ** math.floor(math.log10(max(min((high - low) / STEPS, value / 10), 1e-12)))
    low = min(low, value)
    at = math.floor(min(max(value, low), high) / step + 1e-9) * step
    low, high = math.floor(low / step) * step, math.ceil(high / step) * step
    return Slider(name, label, unit, *(f"{x:.6g}" for x in (low, high, step, at)))


def drawn(folder: Path, params: str, given: Mapping[str, str]) -> tuple[str, str]:
    """The region as an ``svg`` element, and a sentence on its best pair or on why it is empty.

    Parameters
    ----------
    folder, params
        The parameter file.
    given : mapping of str
        Values of the sliders by name.

    Raises
    ------
    UsageError
        A value is no number above zero.
    """
    pf = read(folder / params)
    numbers = {one.name: _number(one, given) for one in sliders(folder, params)}
    highest = _limits(pf) | {name: value for name, value in numbers.items() if _kind(name)}
    limits = _limits_with(pf, highest)
    region = visible_region(pf, limits=limits, d=numbers.get("d", 1.0), t=numbers.get("t", 1.0))
    words = region.conflict if region.empty else f"Greatest metal removal rate: {region.best.words}."
    if pf.identity.simulated:
        words = f"NOT MEASURED (simulated). {words}"
    if not region.empty and not region.best.tested:
        words += " EXTRAPOLATED: this pair lies outside the tested region of the laws."
    return svg(1, _drawing(region, highest)), " ".join([words, *_bounds(pf)[1]])


def _number(slider: Slider, given: Mapping[str, str]) -> float:
    text = given.get(slider.name, slider.value)
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (value > 0 and math.isfinite(value)):
        raise UsageError(f"{slider.label}: {text[:40]!r} is no number above zero.")
    return value


def _drawing(region: VisibleRegion, highest: Mapping[str, float]) -> PanelDrawing:
    """Speed and feed on logarithmic axes: the region shaded, the limit of each response, the best pair."""
    low, high = region.box.low, region.box.high
    names = ("V [m/min]", "f [mm/rev]")
    axes = [_axis(float(a), float(b), name) for a, b, name in zip(low, high, names, strict=True)]
    x, y = (np.linspace(axis.low, axis.high, POINTS) for axis in axes)
    V, f = np.meshgrid(np.exp(x), np.exp(y))
    inside = np.asarray(region.contains(V, f), dtype=float)
    level = {name: surface.value(np.stack([np.log(V), np.log(f)], axis=-1)) for name, surface in region.planes.items()}

    def draw(panel: PanelCanvas) -> None:
        if inside.any():
            panel.ax.contourf(x, y, inside, [0.5, 1.5], colors=[TESTED])
        for name, values in level.items():
            if name in highest and values.min() < highest[name] < values.max():
                found = panel.ax.contour(x, y, values, np.array([highest[name]]), colors=LIMIT, linewidths=1.6).points
                if len(found[0]):
                    at = panel.at(*found[0][len(found[0]) // 2])
                    panel.text(*at, f"{name} {highest[name]:.4g}", "middle", "f-limit halo")
        if not region.empty:
            at = math.log(region.best.V), math.log(region.best.f)
            panel.ax.plot([at[0]], [at[1]], color=LINE, marker="o", ms=8, lw=0)
            panel.text(*panel.at(*at), " best", style="f-ink halo")

    words = ", ".join(f"{name} at most {value:.4g}" for name, value in highest.items() if name in region.planes)
    title = "Region of speed and feed within the limits"
    return PanelDrawing(title, f"{title}: {words}; shaded.", axes[0], axes[1], draw, Margins(height=280))


def _axis(low: float, high: float, name: str) -> PanelAxis:
    """An axis of natural logarithms with ticks at its ends and middle."""
    margin = MARGIN * (high - low)
    ticks = [low, (low + high) / 2, high]
    return PanelAxis(low - margin, high + margin, ticks, [f"{math.exp(t):.3g}" for t in ticks], name)
