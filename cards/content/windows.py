"""Windows of operation and settings of controllers as parts of a card."""

from typing import Any

from ...parameters import (
    AdaptiveForceSection,
    Bound,
    Covariance,
    FeedLimit,
    LimitInterval,
    LimitsSection,
    LoadLineSection,
    ParameterFile,
    Range,
    RoughnessSection,
)
from .dynamics import sentence
from .numbers import fact, figure, percent, quantity
from .parts import Named, Window
from .region import operation_window

ALONE = "The file has no power law in V and f of what they limit, so no window of operation is told from them."
BOUNDS = {"power": "power", "force": "force", "wear": "wear"}
RANGES = {"feed": "feed", "feed_rate": "feed rate", "speed": "cutting speed", "spindle_speed": "spindle speed"}


def windows(pf: ParameterFile) -> tuple[Window, ...]:
    """Limits, window of operation, and the settings of each controller that the file has some for."""
    window = operation_window(pf)
    found = (
        None if pf.limits is None else limits_window(pf.limits, alone=window is None),
        window,
        None if pf.load_line is None else load_line_window(pf.load_line),
        None if pf.roughness is None else roughness_window(pf.roughness, pf),
        None if pf.adaptive_force is None else adaptive_force_window(pf.adaptive_force),
    )
    return tuple(each for each in found if each is not None)


def limits_window(limits: LimitsSection, *, alone: bool = False) -> Window:
    """What machine, tool and work allow; ``alone`` where no window of operation goes with them."""
    facts: list[Named] = []
    for name, words in BOUNDS.items():
        bound: Bound | None = getattr(limits, name)
        if bound is not None:
            facts += fact(f"{words}{f' {bound.of}' if bound.of else ''}, at most", figure(bound.value, 6, bound.unit))
    for name, words in RANGES.items():
        each: Range | None = getattr(limits, name)
        if each is not None:
            facts += fact(f"{words}, lowest", figure(each.low, 6, each.unit))
            facts += fact(f"{words}, highest", figure(each.high, 6, each.unit))
    return Window(
        title="Limits", facts=tuple(facts), sentences=("Limits as given, not fitted.", *([ALONE] if alone else []))
    )


def load_line_window(line: LoadLineSection) -> Window:
    """Settings of milling at constant load."""
    wear, feed, load = line.unit_wear, line.unit_feed, line.unit_load
    low, high = line.window
    facts = (
        *fact(f"reference load {line.load}", figure(line.reference, 6, load)),
        *fact("load that a worn tool stands", figure(line.worn, 6, load)),
        *fact("safety factor", figure(line.safety_factor, 6)),
        *_feed("upper feed limit", line.upper, feed, wear),
        *_feed("lower feed limit", line.lower, feed, wear),
        *fact("change the tool from a wear of", figure(low, 6, wear)),
        *fact("change the tool up to a wear of", figure(high, 6, wear)),
        *(fact("probability that the wear lies there", percent(line.probability, 2), line.probability_of)
          if line.probability is not None else ()),
        *fact("dwell on the lower limit", figure(line.dwell, 6, "s")),
    )  # fmt: skip
    sentences = [
        f"the loop holds {line.load} at {quantity(figure(line.reference, 6, load))} by the feed, between the two feed "
        "limits; the tool is changed when the command rests on the lower one",
        *([f"no probability of the wear: {line.probability_of}"] if line.probability is None and line.probability_of
          else []),
        *line.notes,
    ]  # fmt: skip
    by = f", {line.by}" if line.by else ""
    title = f"Constant load, from the law of {line.law}{by}"
    return Window(title=title, facts=facts, sentences=tuple(sentence(text) for text in sentences))


def roughness_window(r: RoughnessSection, pf: ParameterFile) -> Window:
    """Settings of turning at constant roughness."""
    facts = (
        *fact("roughness asked for", figure(r.roughness, 6, r.unit_roughness)),
        *fact("reference force", figure(r.force, 4, r.unit_force), f"from the law's {r.force_from}"),
        *fact("force below which nothing is cut", figure(r.threshold, 6, r.unit_force)),
        *fact("lowest override", figure(r.override_low, 6)),
        *fact("highest override", figure(r.override_high, 6)),
        *fact("programmed feed", figure(r.feed, 6, r.unit_feed)),
        *fact("largest uncut chip thickness", figure(r.chip_thickness, 6, r.unit_feed)),
        *fact("sample time", figure(r.sample_time, 6, "s")),
        *fact("time constant of the feed drive", figure(r.servo_time, 6, "s")),
    )
    sentences = [
        f"{r.law} is held at {quantity(figure(r.roughness, 6, r.unit_roughness))} through a force of "
        f"{quantity(figure(r.force, 4, r.unit_force))}, by the feed override",
        *_reaches(r, pf),
        *r.notes,
    ]
    return Window(title="Constant roughness", facts=facts, sentences=tuple(sentence(text) for text in sentences))


def adaptive_force_window(a: AdaptiveForceSection) -> Window:
    """Settings of adaptive force control."""
    points = (
        fact(f"force at depth {quantity(figure(p.depth, 6, a.unit_depth))}", figure(p.force, 6, a.unit_force))
        for p in a.set_points
    )
    facts = (
        *fact("m", figure(a.m, 6), "first estimate, divided by k"),
        *fact("alpha", figure(a.alpha, 6), "first estimate, divided by k"),
        *fact("beta", figure(a.beta, 6), "first estimate, divided by k"),
        *(
            item
            for name in ("g1", "g2", "g3")
            for item in fact(name, figure(getattr(a, name), 6), "rate of adaptation")
        ),
        *fact("Kd", figure(a.Kd, 6)),
        *fact("lambda", figure(a.lam, 6, "1/s")),
        *(item for point in points for item in point),
        *fact("sample time", figure(a.sample_time, 6, "s")),
        *fact("time of averaging", figure(a.average_time, 6, "s")),
        *fact("lowest command", figure(a.low, 6, a.unit_u)),
        *fact("highest command", figure(a.high, 6, a.unit_u)),
    )
    return Window(title="Adaptive force", facts=facts, sentences=tuple(sentence(note) for note in a.notes))


def _feed(name: str, limit: FeedLimit, unit: str, unit_wear: str) -> tuple[Named, ...]:
    at = f"at a wear of {quantity(figure(limit.wear, 6, unit_wear))}"
    ends = limit.interval
    if isinstance(ends, LimitInterval):
        low, high, level = figure(ends.low, 4, unit), figure(ends.high, 4, unit), percent(ends.level)
        return (
            *fact(name, figure(limit.value, 4, unit), f"{at}; {level.text} % interval by {ends.method}"),
            *fact(f"{name}, low end", low),
            *fact(f"{name}, high end", high),
        )
    return fact(name, figure(limit.value, 4, unit), f"{at}; no interval: {ends.reason}")


def _reaches(r: RoughnessSection, pf: ParameterFile) -> list[str]:
    """What the roughness law says of the reference force, where it can say it."""
    law = pf.laws.get(r.law)
    if law is None or law.by is not None or len(law.factors) != 1 or not isinstance(law.uncertainty, Covariance):
        return []
    if law.residual_se is None:
        return []
    at: dict[str, Any] = {law.factors[0].symbol: r.force}
    return [law.tell("prediction", **at).words]
