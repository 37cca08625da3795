"""Display of the results of this package: one registered function per class."""

import numpy as np

from ..core.arrays import Ints
from ..core.display import Display, TextTable, display_of
from ..core.rounding import format_plain
from .constant_load_milling.runs import ToolRun
from .constant_load_milling.steady import SteadyLife
from .loop import Trace
from .recursion.distribution import LifeDraws
from .recursion.interval_optimum import Choice
from .recursion.laws import LifeLaws, Terms
from .recursion.life import FixedLife, Life
from .region.probability import Feasibility
from .region.visible import VisibleRegion, WearFront
from .roughness.simulations import TurningRun

MOST_ROWS = 12


@display_of.register
def of_trace(trace: Trace) -> Display:
    """Duration, last measurement, and events."""
    command, measurement = trace.labels
    seen = trace.measurement[np.isfinite(trace.measurement)]
    last = f", last {measurement} {format_plain(float(seen[-1]))}" if seen.size else ""
    head = f"simulated, {len(trace.time)} samples over {trace.time[-1]:g} s of {measurement} under {command}{last}"
    counted = {event.what: 0 for event in trace.events}
    for event in trace.events:
        counted[event.what] += 1
    return Display(head, tuple((what, f"{n} times, first at {trace.first(what):g} s") for what, n in counted.items()))


@display_of.register
def of_tool_run(run: ToolRun) -> Display:
    """State of the tool at the end, time, length, wear, feed and metal removed."""
    state = "worn out" if run.worn else "not worn out"
    head = (
        f"simulated, {state} after {run.time / 60:.3g} min in the cut, {run.length:.0f} mm in {len(run.passes)} passes"
    )
    facts = [("wear", format_plain(run.wear)), ("time on the lower limit", f"{run.rested:.3g} s")]
    if run.time > 0:
        facts.insert(1, ("mean feed", f"{run.mean_feed:.0f} mm/min"))
    if run.removed is not None:
        facts.append(("removed", f"{run.removed:.0f} mm3"))
    return Display(head, tuple(facts))


@display_of.register
def of_turning_run(cut: TurningRun) -> Display:
    """Duration, range of roughness, and feed limits."""
    Ra = cut.Ra[np.isfinite(cut.Ra)]
    span = f"Ra {format_plain(Ra.min(), 3)} to {format_plain(Ra.max(), 3)} um" if Ra.size else "no roughness known"
    return Display(
        f"simulated cut of {cut.trace.time[-1]:g} s, {span}, feed within {cut.low:g} and {cut.high:g} mm/rev"
    )


@display_of.register
def of_life(life: Life) -> Display:
    """Life and metal removed; table of the intervals."""
    wear, n = life.laws.wear, len(life.time)
    ended = "" if life.ended else ", not worn out by then"
    head = (
        f"calculated, {life.minutes:g} min{ended}, {life.removed / 1000:.4g} cm3 removed, "
        f"{life.per_minute / 1000:.4g} cm3/min at d {life.laws.d:g} mm"
    )
    rows = tuple(
        (f"{life.time[k]:g}", f"{life.V[k]:.4g}", f"{life.f[k]:.3g}", f"{life.AW[k]:.3g}", f"{life.MRR[k] / 1000:.4g}")
        for k in _shown(n)
    )
    header = ("to min", "V, m/min", "f, mm/rev", f"{wear.response}, {wear.unit}", "MRR, cm3/min")
    return Display(head, (), TextTable(header, rows) if rows else None)


@display_of.register
def of_life_draws(found: LifeDraws) -> Display:
    """Intervals of life and metal removed, and the share of edges that end before the plan."""
    of = "one plan on edges drawn at random" if found.of == "plan" else "a plan of its own for each draw"
    minutes, removed = found.band("minutes"), [v / 1000 for v in found.band("removed")]
    head = (
        f"{len(found.minutes)} draws, {of}: {minutes[1]:.3g} min (95 % {minutes[0]:.3g} to {minutes[2]:.3g}), "
        f"{removed[1]:.4g} cm3 ({removed[0]:.4g} to {removed[2]:.4g})"
    )
    facts = (("plan as fitted", f"{found.plan.minutes:g} min, {found.plan.removed / 1000:.4g} cm3"),
             ("worn out before the plan ends", f"{found.ends_early:.1%}"))  # fmt: skip
    return Display(head, facts)


@display_of.register
def of_laws(laws: LifeLaws) -> Display:
    """The laws at their depth, with their limits."""
    terms = (laws.wear, *(law for _, law in laws.limited))
    head = "; ".join(f"{_terms(law)}, at most {law.most:g} {law.unit}" for law in terms)
    facts = (("V", f"{laws.V[0]:g} to {laws.V[1]:g} m/min"), ("f", f"{laws.f[0]:g} to {laws.f[1]:g} mm/rev"))
    return Display(f"d {laws.d:g} mm: {head}", facts, None, laws.notes)


def _shown(count: int) -> Ints:
    """Evenly spaced rows of a table, at most `MOST_ROWS`."""
    return np.unique(np.linspace(0, count - 1, min(count, MOST_ROWS)).astype(int))


def _terms(law: "Terms") -> str:
    powers = [(name, getattr(law, name)) for name in ("V", "f", "t", "AW")]
    return " ".join([f"{law.response} = {format_plain(np.exp(law.ln_c))}", *(f"{x}^{k:g}" for x, k in powers if k)])


@display_of.register
def of_fixed(pair: FixedLife) -> Display:
    """The pair, its life and metal removed."""
    over = f", exceeding the limits of {' and '.join(pair.passes)}" if pair.passes else ""
    head = f"calculated, V {pair.V:.4g} m/min, f {pair.f:.3g} mm/rev: {pair.minutes:.3g} min"
    return Display(f"{head}, {pair.removed / 1000:.4g} cm3, {pair.per_minute / 1000:.4g} cm3/min{over}")


@display_of.register
def of_choice(pair: Choice) -> Display:
    """The pair with its removal rate, wear and active limits."""
    held = f"; {' and '.join(pair.stops)} active" if pair.stops else ""
    head = f"V {pair.V:.4g} m/min, f {pair.f:.3g} mm/rev: MRR {pair.MRR / 1000:.4g} cm3/min"
    return Display(f"{head}, AW {pair.AW:.3g}{held}")


@display_of.register
def of_steady(life: SteadyLife) -> Display:
    """Time, length and wear at the lower limit, of one tool or as medians."""
    n = len(life.time)
    wear, time, length = (float(np.nanmedian(v)) if np.isfinite(v).any() else np.nan
                          for v in (life.wear, life.time, life.length))  # fmt: skip
    who = "the tool" if n == 1 else f"median of {n} tools"
    return Display(
        f"{who} reaches the lower limit after {time / 60:.3g} min and {length:.0f} mm, wear {format_plain(wear, 3)}"
    )


@display_of.register
def of_region(region: VisibleRegion) -> Display:
    """The best pair, or the conflict of limits; table of the corners."""
    at = region.at_words
    if region.empty:
        return Display(f"no feasible pair at {at}: {region.conflict}", sentences=region.notes)
    rows = tuple((c.letter, f"{c.V:.4g}", f"{c.f:.3g}", " and ".join(c.limits)) for c in region.corners)
    head = f"{len(region.corners)} corners at {at}; best {region.best.words}"
    return Display(head, (), TextTable(("corner", "V, m/min", "f, mm/rev", "limits"), rows), region.notes)


@display_of.register
def of_feasibility(found: Feasibility) -> Display:
    """Range of the probability, and its value at the best pair."""
    low, high = float(found.probability.min()), float(found.probability.max())
    head = (
        f"probability that {found.of} keeps every limit, from {found.count} draws: {low:.0%} to {high:.0%} over "
        f"V {found.V[0]:g} to {found.V[-1]:g} m/min and f {found.f[0]:g} to {found.f[-1]:g} mm/rev"
    )
    best = (
        ()
        if found.region.empty
        else (("at the best pair by the point estimates", f"{found.at(*found.region.best.xy):.1%}"),)
    )
    return Display(head, best, None, found.sources)


@display_of.register
def of_front(front: WearFront) -> Display:
    """Table from the greatest removal rate to the least wear."""
    rows = tuple(
        (
            f"{front.loss[k]:.0%}",
            f"{front.V[k]:.4g}",
            f"{front.f[k]:.3g}",
            f"{front.MRR[k] / 1000:.4g}",
            f"{front.wear[k]:.3g}",
        )
        for k in _shown(len(front.loss))
    )
    header = ("loss of MRR", "V, m/min", "f, mm/rev", "MRR, cm3/min", f"{front.symbol}, {front.unit}")
    head = (
        f"{front.symbol} {front.wear[0]:.3g} {front.unit} at the greatest MRR of {front.MRR[0] / 1000:.4g} cm3/min, "
        f"{front.wear[-1]:.3g} {front.unit} at a loss of {front.loss[-1]:.0%}"
    )
    return Display(head, (), TextTable(header, rows))
