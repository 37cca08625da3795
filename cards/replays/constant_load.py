"""Report on milling at constant load: regulation, tool change, and gain over constant feed."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ...controllers.constant_load_milling.control_laws import line_of, loop_of
from ...controllers.constant_load_milling.cut_model import CutModel, unit_factor
from ...controllers.constant_load_milling.runs import ToolRun, constant_feed_run, constant_load_run, criterion
from ...controllers.constant_load_milling.steady import drawn_life
from ...controllers.region.operating_point import three
from ...core.errors import ParameterError
from ...core.rounding import format_rounded
from ...parameters.checks.report import worn_past_window
from . import Replayed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...core.arrays import Array
    from ...parameters import ParameterFile
    from ...parameters.draws import Draws
    from ...parameters.exports.loop import LoadLoop
    from ...parameters.sections.load_line import LoadLineSection

TITLE = "Milling at constant load (Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587)"
LEVEL = 0.90


def lacks(pf: "ParameterFile") -> str:
    """Reason why this file cannot drive the system; empty where it can."""
    if pf.load_line is None:
        return "The file has no settings of milling at constant load; set them with `fitmodels settings params.json`."
    if pf.pi is None:
        return "The file has no PI gains; find them with `fitmodels tune params.json`."
    if pf.dynamics is None:
        return "The file has no dynamics of the drive; identify them with `fitmodels ident record.csv`."
    try:
        loop, cut = loop_of(pf), CutModel.from_parameters(pf)
    except ParameterError as error:
        words = str(error).removeprefix("not exported, ")
        return words[:1].upper() + words[1:]
    if abs(cut.sample_time - loop.sample_time) > 1e-9 * loop.sample_time:
        return (
            f"The drive was identified at {cut.sample_time:g} s and the loop runs at {loop.sample_time:g} s; tune at "
            f"{cut.sample_time:g} s to replay it."
        )
    return ""


def replayed(pf: "ParameterFile", draws: "Mapping[str, Draws]", seed: int) -> Replayed:
    """Report on a tool at constant load until its change, and on one at constant feed."""
    line = line_of(pf)
    run, fixed, cut = constant_load_run(pf, seed=seed), constant_feed_run(pf), CutModel.from_parameters(pf)
    (share, past), worn = worn_past_window(pf), wear_symbol(pf)
    loop = loop_of(pf)
    mixed, of_mixed = _mixed(pf)
    lines = (
        _change(run, line, worn), past, _settings(line), _monitoring(loop), _held(run, line),
        *_gain(run, fixed, pf, line),
        _limit(pf, run, line), _overload(loop, cut, line), *mixed, _scaling(pf, cut), *_spread(pf, draws),
    )  # fmt: skip
    facts = {**_facts(run, fixed, cut), "worn_past_window": share, "monitoring": _monitored(loop), **of_mixed}
    return Replayed("constant-load", TITLE, lines, _assumed(pf, cut), facts, _figures(run, fixed, pf))


def wear_symbol(pf: "ParameterFile") -> str:
    """Symbol of the wear in the load law: ``VB``."""
    return pf.laws[line_of(pf).law].factors[-1].symbol


def _change(run: ToolRun, line: "LoadLineSection", worn: str) -> str:
    at = f"{worn} {three(run.wear)} {line.unit_wear} after {run.length:.0f} mm and {run.time / 60:.2f} min in the cut"
    low, high = line.window
    if not run.worn:
        return f"No tool change was signalled: the replay stopped at {at}, with the feed above its lower limit."
    where = "inside" if low <= run.wear <= high else "outside"
    return f"Change the tool at {at}: {where} the window of {low:g} to {high:g} {line.unit_wear}."


def _settings(line: "LoadLineSection") -> str:
    return (
        f"Reference load {line.reference:g} {line.unit_load}, {line.safety_factor:g} times the {line.worn:g} of a "
        f"worn tool; feeds from {line.lower.value:.4g} to {line.upper.value:.4g} {line.unit_feed}."
    )


def _monitoring(loop: "LoadLoop") -> str:
    """Faults and their effects, with the time from the first wrong reading to the safe state."""
    causes = [f"invalid for {loop.lost_after:g} s"]
    causes += [f"equal for {loop.stuck_after:g} s in the cut"] if loop.stuck_after else []
    causes += [f"without a heartbeat for {loop.heartbeat:g} s"] if loop.heartbeat else []
    named = " or ".join(filter(None, (", ".join(causes[:-1]), causes[-1])))
    fall = (loop.high - loop.low) / loop.back_off
    stop = "inhibits the feed and " if loop.stop_on_fault else ""
    return (
        f"A load that is {named} is a fault, which {stop}takes the feed to {loop.feed_low:.4g} {loop.unit_feed} within "
        f"a further {fall:.3g} s; a mean load above {loop.overload_at:.4g} {loop.unit_load} for "
        f"{loop.overload_after:g} s inhibits it (calculated from the settings, not simulated)."
    )


def _held(run: ToolRun, line: "LoadLineSection") -> str:
    if run.worst_mean is None:
        return "No completed pass was long enough to evaluate the regulation: 4 s of each are excluded."
    shares = [abs(p.mean_load / run.reference - 1) for p in run.regulated if p.mean_load is not None]
    within = "within" if max(shares) <= 0.01 else "not within"
    spread = 100 * max(p.spread for p in run.regulated if p.spread is not None) / line.reference
    spread_over = f"{spread:.1f} % of it" if spread >= 0.05 else "less than 0.1 % of it, as no noise is simulated"
    return (
        f"After 4 s the mean load of each of {len(shares)} passes is within {100 * max(shares):.2f} % of the "
        f"reference ({within} the 1 % of the paper) until the lower limit is reached; range of readings in a pass: "
        f"{spread_over}."
    )


def _gain(run: ToolRun, fixed: ToolRun, pf: "ParameterFile", line: "LoadLineSection") -> tuple[str, ...]:
    if not (run.worn and fixed.worn):
        return ("The gain over constant feed is not known: a tool did not reach its end.",)
    per = unit_factor("mm/min", line.unit_feed)
    baseline = f"{three(fixed.mean_feed * per)} {line.unit_feed}, stopped at {criterion(pf):.4g} {line.unit_wear}"
    if run.rate is not None and fixed.rate is not None:
        rate = (
            f"metal removal {run.rate:.2f} against {fixed.rate:.2f} mm3/s ({100 * (run.rate / fixed.rate - 1):+.0f} %)"
        )
    else:
        gain = run.mean_feed / fixed.mean_feed - 1
        feeds = f"mean feed {three(run.mean_feed * per)} against {three(fixed.mean_feed * per)} {line.unit_feed}"
        rate = f"{feeds} and metal removal in proportion ({100 * gain:+.0f} %)"
    life = f"life {run.length:.0f} against {fixed.length:.0f} mm ({100 * (run.length / fixed.length - 1):+.0f} %)"
    return (f"Against a constant feed of {baseline}: {life}, {rate}.",)


def _limit(pf: "ParameterFile", run: ToolRun, line: "LoadLineSection") -> str:
    dwell = loop_of(pf).dwell
    reached = next((p.number for p in run.passes if p.limited), None)
    if reached is None:
        return "The command never reached its lower limit."
    return (
        f"The averaged command reached its lower limit, {line.lower.value:.4g} {line.unit_feed}, in pass {reached} and "
        f"stayed there for {run.rested:.1f} s in the cut; {dwell:g} s signal the tool change."
    )


def _overload(loop: "LoadLoop", cut: CutModel, line: "LoadLineSection") -> str:
    """Load of a worn tool at the programmed feed."""
    worst = cut.A + cut.B * loop.feed_programmed + cut.k1 * line.lower.wear
    tool = f"a tool worn by {three(line.lower.wear)} {line.unit_wear}"
    head = f"At the programmed {loop.feed_programmed:.4g} {line.unit_feed} {tool}"
    if worst <= line.worn:
        return f"{head} has a load of {worst:.3f} {line.unit_load}, below the limit of {line.worn:g}."
    return (
        f"{head} would have a load of {worst:.3f} {line.unit_load}, above the limit of {line.worn:g}: the first cut "
        "begins at the lower limit, each further one with the last feed."
    )


def _mixed(pf: "ParameterFile") -> tuple[tuple[str, ...], dict[str, object]]:
    """The mixed path of slot and end milling of the paper, from both of its files; empty for another file."""
    from ...controllers.constant_load_milling.mixed_path import mixed_run
    from ...parameters.published import published
    from ...parameters.published.milling import end_milling

    if pf.provenance.options.get("paper") != "CLM-2023":
        return (), {}
    run = mixed_run([published("CLM-2023-slot"), end_milling(upper=1100.0)])
    asked = ("slot", "end")[run.passes[-1].kind]
    sentence = (
        "Slot and end milling in turn with one tool (Table 3: 500 to 700 and 600 to 1100 mm/min; passes of 150 mm are "
        f"a reconstruction): {asked} milling signals the change, at VB {run.wear:.0f} um after {run.length:.0f} mm; "
        "the paper prints 179.48 and 199.63 um."
    )
    return (sentence,), {"mixed_path": {"wear_um": run.wear, "length_mm": run.length, "asked_by": asked}}


def _scaling(pf: "ParameterFile", cut: CutModel) -> str:
    pi = pf.pi
    unit = f"{cut.unit_feed} per {cut.unit_u or 'unit of the input'}"
    implied = f"The load line and the drive's gain imply a scaling of {cut.scaling:.4g} {unit} (derived, not measured)"
    if pi is not None and pi.scaling_u != 1 and abs(pi.scaling_u / cut.scaling - 1) > 0.02:
        off = f"{pi.scaling_u / cut.scaling:.2f} times as large"
        return f"{implied}; the gains were tuned for {pi.scaling_u:.4g}, and the loop gain is {off} as designed."
    return f"{implied}."


def _spread(pf: "ParameterFile", draws: "Mapping[str, Draws]") -> tuple[str, ...]:
    life, used = drawn_life(pf, draws)
    if not used:
        return ("No draws of the load and wear laws, so no band of the life.",)
    good = np.isfinite(life.length)
    if not good.any():
        return (f"No tool of {good.size} posterior draws of the laws of {' and '.join(used)} reaches the lower limit.",)
    life_band, wear_band = (_band(of[good]) for of in (life.length, life.wear))
    worn = f"{wear_symbol(pf)} at the lower limit {wear_band}"
    unit = CutModel.from_parameters(pf).unit_wear
    lost = "" if good.all() else f" ({100 * np.mean(~good):.0f} % never reach the limit)"
    return (
        f"Over {good.size} posterior draws of the laws of {' and '.join(used)}{lost} the life is {life_band} "
        f"mm and {worn} {unit} ({100 * LEVEL:.0f} % bands of the "
        "laws, calculated without the dwell and without the scatter of tools).",
    )


def _band(values: "Array") -> str:
    """Ends of the band of some draws, to the digits of its width."""
    a, b = np.quantile(values, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return " to ".join(format_rounded(end, min(b - a, abs(end)) / 2)[0] for end in (a, b))


def _assumed(pf: "ParameterFile", cut: CutModel) -> tuple[str, ...]:
    from ...parameters.exports.loop import loop_settings

    notes = [note for section in (*pf.laws.values(), pf.pi, pf.load_line) if section for note in section.notes]
    marked = [n for n in notes if any(word in n.lower() for word in ("assum", "reconstruct", "derived"))]
    return (
        "The simulated cut is the load line and the wear law; its load follows the feed with the drive's dynamics, "
        "gain 1.",
        "Passes of 150 mm, with 2 s out of the cut between them.",
        *loop_settings(pf, own_form=True).assumed,
        *marked,
        *(() if cut.area else ("no width and depth of cut in the wear law, so no metal removal rate",)),
    )


def _monitored(loop: "LoadLoop") -> dict[str, object]:
    """Settings of the monitoring with their units in the names; times in s, 0 where something is not monitored."""
    names = ("arm_after", "lost_after", "stuck_after", "heartbeat", "overload_after")
    return {
        "load_low": loop.load_low, "load_high": loop.load_high, "overload_load": loop.overload_at,
        "unit_load": loop.unit_load, **{f"{name}_s": getattr(loop, name) for name in names},
        "on_fault": "stop" if loop.stop_on_fault else "lower limit",
    }  # fmt: skip


def _facts(run: ToolRun, fixed: ToolRun, cut: CutModel) -> dict[str, object]:
    found = {}
    for name, of in (("constant_load", run), ("constant_feed", fixed)):
        found[name] = {
            "tool_changed": of.worn, "wear": of.wear, "unit_wear": cut.unit_wear, "length_mm": of.length,
            "time_in_cut_s": of.time, "mean_feed_mm_per_min": of.mean_feed, "removal_rate_mm3_per_s": of.rate,
        }  # fmt: skip
    return {
        **found,
        "passes": len(run.passes),
        "worst_mean_load_share": run.worst_mean,
        "rested_on_lower_limit_s": run.rested,
        "events": [[event.time, event.what] for event in run.trace.events[:100]],
        "scaling": cut.scaling,
        "unit_scaling": f"{cut.unit_feed} per {cut.unit_u}",
        "simulated": True,
    }


def _figures(run: ToolRun, fixed: ToolRun, pf: "ParameterFile") -> "dict[str, Figure]":
    from ...controllers.constant_load_milling.figures import pass_figure, run_figure

    line = line_of(pf)
    number = 2 if len(run.passes) > 1 else 1
    return {
        "constant_load": run_figure(run, line, fixed, pf.identity.work, wear_symbol(pf)),
        "constant_load_pass": pass_figure(run, line, number),
    }
