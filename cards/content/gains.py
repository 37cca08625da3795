"""Controller gains as a part of a card: settings, specification, performance."""

from collections.abc import Mapping

from ...parameters.sections.dynamics import DynamicsSection, PiFigures, PiSection
from .numbers import INFINITE, NONE, count, fact, figure, percent, sentence
from .parts import FactPart, GainsPart, NumberPart

FORMS = {
    "position": "position: u_k = kp e_k + ki S_k",
    "incremental": "incremental: u_k = u_(k-1) + kp (e_k - e_(k-1)) + ki (S_k - S_(k-1))",
    "incremental_sum": "incremental with the sum: u_k = u_(k-1) + kp e_k + ki S_k",
}
RULES = {
    "backward": "S_k = S_(k-1) + T e_k (backward)",
    "forward": "S_k = S_(k-1) + T e_(k-1) (forward)",
    "trapezoidal": "S_k = S_(k-1) + T (e_k + e_(k-1)) / 2 (trapezoidal)",
}
WINDUP = {"clamping": "clamping", "back_calculation": "back calculation", "none": "none"}
# name of a figure -> words, unit ("%": a share; "u": of the command), whether a specification is a lower limit
FIGURES: Mapping[str, tuple[str, str, bool]] = {
    "rise_time": ("rise time, 10 to 90 %", "s", False),
    "settling_time": ("settling time, within 2 %", "s", False),
    "overshoot": ("overshoot", "%", False),
    "undershoot": ("undershoot", "%", False),
    "steady_error": ("steady-state error", "%", False),
    "ms": ("Ms, peak of |1/(1 + L)|", "", False),
    "mt": ("Mt, peak of |L/(1 + L)|", "", False),
    "phase_margin": ("phase margin", "°", True),
    "gain_margin": ("gain margin (factor)", "", True),
    "delay_margin": ("delay margin", "s", True),
    "disturbance_peak": ("peak after a unit load disturbance", "", False),
    "disturbance": ("peak after a unit load disturbance", "", False),
    "travel": ("total variation of the command", "", False),
    "peak_u": ("peak of the command", "", False),
    "noise_gain": ("noise gain of the command", "", False),
    "integral_time": ("integral time", "s", False),
}
CHOSEN = {  # selection rules that need an explanation
    "smallest ms": "of the gains that meet the specification, these have the smallest peak sensitivity, Ms",
    "smallest iae": "of the gains that meet the specification, these have the smallest integral of absolute error",
}
UNBOUNDED = ("rise_time", "settling_time", "gain_margin", "delay_margin")


def gains_part(pi: PiSection | None, dynamics: DynamicsSection | None) -> GainsPart | None:
    """Gains with all that a controller needs to run them."""
    if pi is None:
        return None
    return GainsPart(
        facts=as_they_run(pi),
        reached=(*reached(pi.figures), *_held(pi)),
        asked=asked(pi),
        sentences=tuple(sentence(text) for text in _sentences(pi, dynamics)),
    )


def as_they_run(pi: PiSection) -> tuple[FactPart, ...]:
    """Kp, Ki and Ti with their units, form and limits."""
    per = f"{pi.unit_u or 'command'}/{pi.unit_y or 'measurement'}"
    return (
        *fact("Kp", figure(pi.kp, 6, per)),
        *fact("Ki", figure(pi.ki, 6, f"{per}/s"), "parallel: Kp does not multiply it"),
        *(fact("Ti", figure(pi.ti, 6, "s"), "Kp / Ki") if pi.ti is not None else ()),
        *fact("sample time", figure(pi.sample_time, 6, "s")),
        *(
            fact("setpoint weight", figure(pi.setpoint_weight, 6), "of the reference in the proportional part")
            if pi.setpoint_weight != 1
            else ()
        ),
        *fact("form", NONE, FORMS[pi.form]),
        *fact("integral", NONE, RULES[pi.integration]),
        *fact("delay", count(pi.delay, "samples")),
        *(fact("low-pass of the measurement", figure(pi.filter_time, 6, "s")) if pi.filter_time else ()),
        *(fact(f"moving average of the {pi.average_of}", count(pi.average, "samples")) if pi.average > 1 else ()),
        *fact("minimum command", figure(pi.low, 6, pi.unit_u)),
        *fact("maximum command", figure(pi.high, 6, pi.unit_u)),
        *fact("rate limit of the command", figure(pi.rate, 6, f"{pi.unit_u}/s".lstrip("/"))),
        *fact("anti-windup", NONE, WINDUP[pi.anti_windup]),
        *fact("tracking time", figure(pi.tracking_time, 6, "s")),
        *(
            fact("units of the command per unit of the model input", figure(pi.scaling_u, 6))
            if pi.scaling_u != 1
            else ()
        ),
        *(
            fact("units of the measurement per unit of the model output", figure(pi.scaling_y, 6))
            if pi.scaling_y != 1
            else ()
        ),
    )


def reached(figures: PiFigures | None) -> tuple[FactPart, ...]:
    """Performance of the loop on the dynamics of the file."""
    if figures is None:
        return ()
    out: list[FactPart] = []
    for name, (words, unit, _) in FIGURES.items():
        value = getattr(figures, name, None)
        endless = value is None and name in UNBOUNDED and name in figures.model_fields_set
        out += fact(words, INFINITE if endless else _number(value, unit))
    return tuple(out)


def asked(pi: PiSection) -> tuple[FactPart, ...]:
    """The specification: a limit for each specified figure."""
    limits = {} if pi.specification is None else pi.specification.asked
    out: list[FactPart] = []
    for name, value in limits.items():
        words, unit, least = FIGURES[name]
        out += fact(words, _number(value, unit), "at least" if least else "at most")
    return tuple(out)


def _number(value: float | None, unit: str) -> NumberPart:
    return percent(value) if unit == "%" else figure(value, 3, unit)


def _held(pi: PiSection) -> tuple[FactPart, ...]:
    """The probability that the specification holds, what was required, and the share of draws that miss each limit."""
    if pi.probability is None:
        return ()
    words = "" if pi.draws is None else f"share of {pi.draws} models drawn from the uncertainty of the dynamics"
    if pi.required_probability is not None:
        words += f", required {100 * pi.required_probability:g} %"
    ends = zip(("low", "high"), pi.probability_interval or (), strict=False)
    interval = (fact(f"probability, {end} end", percent(p), "95 % interval of the estimate") for end, p in ends)
    missed = ((FIGURES[name][0] if name in FIGURES else name, share) for name, share in pi.missed.items())
    return (
        *fact("probability of meeting the specification", percent(pi.probability), words),
        *(item for each in interval for item in each),
        *fact("required probability", percent(pi.required_probability)),
        *(item for words, share in missed for item in fact(f"share of these that miss {words}", percent(share))),
    )


def _sentences(pi: PiSection, dynamics: DynamicsSection | None) -> list[str]:
    said = [CHOSEN.get(pi.method, f"chosen by {pi.method}")] if pi.method else []
    if pi.verdict is not None and pi.verdict.concern:
        said.append(" ".join([f"verdict on the gains: {pi.verdict.level}.", *pi.verdict.reasons]))
    if pi.forced:
        said.append(f"FORCED: these gains do not meet their specification and were written nevertheless ({pi.forced})")
    if pi.figures is None:
        said.append("the file holds no performance of these gains: tune them, or simulate the loop before it is closed")
    elif not pi.figures.stable:
        said.append("the loop is NOT stable on the dynamics of the file: do not close it")
    else:
        said.append("all figures are computed on the dynamics of the file, not measured on a machine")
    if dynamics is None:
        said.append("the file holds no dynamics, so the gains cannot be checked")
    return [*said, *pi.notes]
