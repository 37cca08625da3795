"""Checks of the dynamics of a file and of its gains on them: stable, of the right sign, within their specification."""

from collections.abc import Iterator, Mapping

import numpy as np

from ...core.text import shortened
from ...core.verdict import LEVELS, RESERVATIONS, USABLE, level_of_probability
from ...datasets.units import canonical
from ..file import ParameterFile
from ..messages import in_unit
from ..sections.base import ModelCovariance
from ..sections.dynamics import DynamicsSection, PiSection
from ..sections.load_line import is_feed
from .loop_figures import closed_loop, figures
from .report import FileFinding

SLACK = 2e-3  # of a limit: figures are read off a grid here, off refined extremes by the tuner
AGREES = 0.01  # of a stated figure
LEAST = ("phase_margin", "gain_margin")  # lower limits
WORDS = {
    "rise_time": "rise time",
    "settling_time": "settling time",
    "ms": "sensitivity peak",
    "phase_margin": "phase margin",
    "gain_margin": "gain margin",
    "delay_margin": "delay margin",
    "disturbance": "peak after a step of load",
    "travel": "travel of the command",
    "peak_u": "largest command",
    "noise_gain": "command per unit of noise",
    "integral_time": "integral time",
    "steady_error": "steady-state error",
}


POOR_FIT = 50.0  # per cent of the own record: below, ident says do not use
SURE = 2.0  # standard errors between the static gain and zero


def _fits(model: DynamicsSection) -> Iterator[FileFinding]:
    """Findings on stated fits that cannot be, or that the verdict does not allow."""
    verdict = model.verdict
    for name, fit, least, allowed in (
        ("held_out_fit", model.held_out_fit, 0.0, USABLE),
        ("own_fit", model.own_fit, POOR_FIT, RESERVATIONS),
    ):
        if fit is not None and fit > 100:
            words = f"dynamics: {name} is {fit:.4g} %, and a fit is at most 100 %; identify again."
            yield FileFinding("fit", False, words)
        elif fit is not None and fit < least and verdict is not None and verdict.concern <= allowed:
            words = f"dynamics: {name} is {fit:.4g} %, which does not allow {verdict.level!r}; identify again."
            yield FileFinding("fit", False, words)


def check_dynamics(model: DynamicsSection) -> Iterator[FileFinding]:
    """Findings on the fits, the stability and the static gain of a model."""
    yield from _fits(model)
    with np.errstate(all="ignore"):
        radius = float(np.abs(model.poles).max(initial=0.0))
        gain = model.dc_gain
    if model.integrating:
        yield from _integrator(model)
        return
    if not model.stable:
        yield FileFinding("dynamics", False, f"dynamics: not stable, a pole at radius {radius:.6g}; identify again.")
        return
    yield FileFinding("dynamics", True, f"dynamics: stable, every pole within radius {radius:.6g}.")
    if not np.isfinite(gain) or gain == 0:
        yield FileFinding(
            "dynamics", False, f"dynamics: the static gain is {gain:g}, so no controller can hold a load."
        )
        return
    se = _gain_se(model)
    unit = f" {model.unit_y}/{model.unit_u}" if model.unit_u and model.unit_y else ""
    if se is not None and abs(gain) < SURE * se:
        words = f"dynamics: the static gain, {gain:.4g}{unit}, has a standard error of {se:.2g}: its sign is not known"
        yield FileFinding("dynamics", False, f"{words}; identify from a longer record or with more amplitude.")
        return
    known = "" if se is None else f", {abs(gain) / se if se else np.inf:.3g} standard errors from zero"
    yield FileFinding("dynamics", True, f"dynamics: the static gain is {gain:.4g}{unit}{known}.")


def _integrator(model: DynamicsSection) -> Iterator[FileFinding]:
    """Findings on a model with one pole at exactly 1."""
    inner = model.without_integrator()
    radius, gain, se = float(np.abs(inner.poles).max(initial=0.0)), inner.dc_gain, _gain_se(model)
    words = "dynamics: integrating, one pole at 1"
    words += f" and every other within radius {radius:.6g}." if len(inner.a) > 1 else "."
    yield FileFinding("dynamics", True, words)
    gain, se = gain / model.sample_time, None if se is None else se / model.sample_time
    unit = f" {model.unit_y}/({model.unit_u} s)" if model.unit_u and model.unit_y else " per second"
    if gain == 0 or (se is not None and abs(gain) < SURE * se):
        words = f"dynamics: the output rises by {gain:.4g}{unit}, standard error {se or 0:.2g}: its sign is not known"
        yield FileFinding("dynamics", False, f"{words}; identify from a longer record or with more amplitude.")
        return
    known = "" if se is None else f", {abs(gain) / se if se else np.inf:.3g} standard errors from zero"
    yield FileFinding("dynamics", True, f"dynamics: for a constant input the output rises by {gain:.4g}{unit}{known}.")


def _gain_slope(name: str, gain: float, *, integrating: bool) -> float:
    """Derivative of b(1)/a(1) by a coefficient, times a(1)."""
    if not name.startswith("a"):
        return 1.0
    # a(1) without the pole at 1 is -sum k a_k: the derivative of a(z) at z = 1
    return -gain * (-float(name[1:]) if integrating else 1.0)


def _gain_se(model: DynamicsSection) -> float | None:
    """Standard error of b(1)/a(1), of an integrating model without its pole at 1, by the delta method."""
    held = model.uncertainty
    if not isinstance(held, ModelCovariance):
        return None
    inner = model.without_integrator() if model.integrating else model
    below, gain, slope = float(np.sum(inner.a)), inner.dc_gain, np.zeros(len(held.of))
    for k, name in enumerate(held.of):
        slope[k] = _gain_slope(name, gain, integrating=model.integrating) / below
    with np.errstate(all="ignore"):
        variance = float(slope @ np.array(held.matrix) @ slope)
    return float(np.sqrt(variance)) if np.isfinite(variance) and variance >= 0 else None


STEP = 0.1  # of the reference load: a step that a tuned loop meets


def reference_step(pf: ParameterFile) -> float | None:
    """Step of the reference that is simulated, unit_y: a tenth of the reference load of the file; None without it."""
    d, line = pf.dynamics, pf.load_line
    return STEP * line.reference if d is not None and line is not None and line.unit_load == d.unit_y else None


def check_gains(pf: ParameterFile) -> Iterator[FileFinding]:
    """Findings on the gains; none where the file has none."""
    pi, model = pf.pi, pf.dynamics
    if pi is None:
        return
    yield from _probable(pi)
    if model is None:
        yield FileFinding("gains", None, "pi: the file has no dynamics, so the gains could not be tested.")
        return
    stop = _fit_together(model, pi) or _no_feed(pf, model, pi)
    if stop:
        yield FileFinding("gains", False, stop)
        return
    yield from _tried(model, pi)
    yield from _within_limits(model, pi, reference_step(pf) or 1.0)


def _within_limits(model: DynamicsSection, pi: PiSection, step: float) -> Iterator[FileFinding]:
    """Finding on limits of the command that cannot give a step, or a rate that cannot give it in the time asked for."""
    gain = abs(model.dc_gain * pi.scaling_y / pi.scaling_u)
    if not gain or not np.isfinite(gain):
        return
    change, asked = step * pi.scaling_y / gain, pi.specification.asked if pi.specification else {}
    u, y = pi.unit_u or "units of the command", pi.unit_y or "units of the measurement"
    what = f"a step of the reference by {step * pi.scaling_y:.4g} {y} needs a change of the command by {change:.4g} {u}"
    odd = []
    if pi.low is not None and pi.high is not None and change > pi.high - pi.low:
        odd.append(f"more than its limits allow, {pi.low:.4g} to {pi.high:.4g} {u}")
    within = asked.get("settling_time", asked.get("rise_time", np.inf))
    if pi.rate is not None and change / pi.rate > within:
        odd.append(f"{change / pi.rate:.3g} s at its rate of {pi.rate:.4g} {u}/s, above the {within:.4g} s asked for")
    if odd:
        known = pi.forced or (pi.verdict is not None and pi.verdict.concern > USABLE)
        yield FileFinding("limits", None if known else False, f"pi: {what}, {', and '.join(odd)}.")


def _probable(pi: PiSection) -> Iterator[FileFinding]:
    """Finding on a verdict that is better than the stated probability of the specification allows."""
    if pi.verdict is None or pi.probability is None:
        return
    upper = pi.probability if pi.probability_interval is None else pi.probability_interval[1]
    allowed = level_of_probability(pi.probability, upper, pi.required_probability)
    if pi.verdict.concern >= allowed:
        return
    required = "" if pi.required_probability is None else f", required {100 * pi.required_probability:g} %"
    words = (
        f"pi: the verdict on the gains is {pi.verdict.level!r}, but their specification holds with probability "
        f"{100 * pi.probability:.4g} % (upper end of its interval {100 * upper:.4g} %{required}), which allows "
        f"{LEVELS[allowed]!r} at best; tune again."
    )
    yield FileFinding("gains", False, words)


def _fit_together(model: DynamicsSection, pi: PiSection) -> str:
    if not np.isclose(model.sample_time, pi.sample_time, rtol=1e-9, atol=0):
        return f"pi: the gains run at {pi.sample_time:g} s and the dynamics at {model.sample_time:g} s; tune again."
    for name, scaling, ours, theirs in (
        ("scaling_u", pi.scaling_u, pi.unit_u, model.unit_u),
        ("scaling_y", pi.scaling_y, pi.unit_y, model.unit_y),
    ):
        same = (canonical(ours) or ours) == (canonical(theirs) or theirs)
        factor = None if same or not (ours and theirs) else in_unit(1.0, theirs, ours)
        if factor is not None and not np.isclose(factor, scaling, rtol=1e-6, atol=0):
            return (
                f"pi: {name} is {scaling:g} from {theirs[:40]!r} of the dynamics to {ours[:40]!r} of the gains, which "
                f"are units of one dimension: {factor:g}. Correct the unit, or tune again."
            )
        if ours and theirs and scaling == 1 and not same:
            return (
                f"pi: the gains are in {ours[:40]!r} and the dynamics in {theirs[:40]!r}, and {name} is 1: state how "
                "many of the first make one of the second."
            )
    if model.b[0] != 0 and pi.delay == 0:
        return "pi: neither dynamics nor gains have a sample of delay, which makes an algebraic loop."
    return ""


def _no_feed(pf: ParameterFile, model: DynamicsSection, pi: PiSection) -> str:
    """Sentence on a command, scaled from that of the dynamics, that is no feed as the limits of the file; or empty."""
    line = pf.load_line
    if line is None or not pi.unit_u or pi.unit_u == model.unit_u or is_feed(pi.unit_u):
        return ""
    return (
        f"pi: the command is in {pi.unit_u[:40]!r}, and the feed limits of the file in {line.unit_feed}; tune "
        f"again with --unit {line.unit_feed}."
    )


def _tried(model: DynamicsSection, pi: PiSection) -> Iterator[FileFinding]:
    closed = closed_loop(model, pi)
    radius = closed.radius
    if not radius < 1:
        sign = np.sign(pi.ki or pi.kp) * np.sign(model.dc_gain)
        why = " (gains and dynamics have opposite signs)" if sign < 0 else ""
        marked = f"; they are marked as forced: {pi.forced}" if pi.forced else ""
        words = f"pi: the loop is not stable on the file's dynamics, a pole at radius {radius:.6g}{why}"
        yield FileFinding("gains", False, f"{words}; tune again{marked.rstrip('.')}.")
        return
    yield FileFinding("gains", True, f"pi: the loop is stable on the file's dynamics, every pole within {radius:.6g}.")
    found = {**figures(closed), "integral_time": np.inf if pi.ti is None else abs(pi.ti)}
    asked = {} if pi.specification is None else pi.specification.asked
    if not asked:
        yield FileFinding("specification", None, "pi: no specification is stated, so none could be tested.")
    else:
        limited = (pi.low, pi.high, pi.rate) != (None, None, None)
        yield _held(asked, found, pi.forced, " without limits of the command" if limited else "")
    further = (
        []
        if pi.specification is None
        else [k for k, v in (pi.specification.model_extra or {}).items() if v is not None]
    )
    if further:
        names = ", ".join(map(shortened, further))
        yield FileFinding("specification", None, f"pi: limits unknown to this version were not tested: {names}.")
    yield from _as_stated(pi, found)


def _held(asked: Mapping[str, float], found: Mapping[str, float], forced: str | None, free: str = "") -> FileFinding:
    missed = [
        f"{WORDS.get(name, name)} {found[name]:.4g} {'below' if name in LEAST else 'above'} the {limit:.4g} asked for"
        for name, limit in asked.items()
        if not _met(name, found[name], limit)
    ]
    if not missed:
        figures_met = ", ".join(
            f"{WORDS.get(name, name)} {found[name]:.4g} ({limit:.4g})" for name, limit in asked.items()
        )
        return FileFinding("specification", True, f"pi: the specification is met, recomputed{free}: {figures_met}.")
    marked = f"; they are marked as forced: {forced.rstrip('.')}" if forced else ""
    return FileFinding("specification", None if forced else False, f"pi: the gains miss {', '.join(missed)}{marked}.")


def _met(name: str, value: float, limit: float) -> bool:
    if name in LEAST:
        return value >= limit * (1 - SLACK)
    return abs(value) <= limit * (1 + SLACK) + (1e-6 if name in ("overshoot", "undershoot", "steady_error") else 0.0)


def _as_stated(pi: PiSection, found: Mapping[str, float]) -> Iterator[FileFinding]:
    """Finding on stated figures that differ from those of these gains on these dynamics."""
    if pi.figures is None:
        return
    odd = []
    for name in ("rise_time", "settling_time", "ms", "phase_margin", "gain_margin", "delay_margin"):
        stated = getattr(pi.figures, name)
        if stated is not None and not np.isclose(stated, found[name], rtol=AGREES, atol=pi.sample_time * AGREES):
            odd.append(f"{WORDS[name]} {stated:.4g} is {found[name]:.4g}")
    if odd or not pi.figures.stable:
        why = "; ".join(odd) or "they are stated to be unstable"
        yield FileFinding(
            "figures", False, f"pi: stated figures are not those of these gains on these dynamics ({why})."
        )
