"""Facts of a watch: one description for terminal, page, OPC UA server and JSON stream."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from math import inf, isfinite
from typing import TYPE_CHECKING, Any, Final

from ..core.errors import FitmodelsError

if TYPE_CHECKING:
    from .advice import Bounds
    from .monitor import Monitor

Facts = dict[str, Any]

SCHEMA: Final = "fitmodels.live/1"
SHADOW: Final = "shadow mode: nothing is written to the machine"
CALENDAR: Final = 1e8  # s: larger times are since 1970, smaller ones since the start of a recorded run


@dataclass(slots=True)
class Reading:
    """The last reading; it is shown and not kept.

    Attributes
    ----------
    time : float or None
        s, by the clock of the source.
    state : str
        ``"starting"``, ``"off"``, ``"idle"``, ``"entry"``, ``"cutting"``, ``"lost"`` or ``"stopped"``.
    open : float
        Minutes of the open cut that are in no window yet.
    conditions, loads : mapping
        As the source gave them.
    source : mapping
        ``name``, ``state``, ``text`` and ``age`` in s.
    journal : mapping
        ``file``, ``records`` and ``fault``.
    control : mapping
        ``phase`` and ``text``: what is written to the machine, and why not where it is not.
    advice : list of dict
        ``time``, ``kind``, ``text``, ``probability`` and ``settings`` for the next cut, as of the end of the last.
    """

    time: float | None = None
    state: str = "starting"
    open: float = 0.0
    conditions: Mapping[str, float] = field(default_factory=dict)
    loads: Mapping[str, float] = field(default_factory=dict)
    source: Mapping[str, Any] = field(default_factory=dict)
    journal: Mapping[str, Any] = field(default_factory=dict)
    control: Mapping[str, Any] = field(default_factory=lambda: {"phase": "shadow", "text": SHADOW})
    advice: list[dict[str, Any]] = field(default_factory=list)


def clock(time: float | None) -> str:
    """A time as text: of day where it is since 1970, else since the start of the run.

    >>> clock(83.25), clock(1700000000.0), clock(None)
    ('0:01:23', '2023-11-14 22:13:20', '-')
    """
    if time is None:
        return "-"
    if time < CALENDAR:
        minutes, seconds = divmod(int(time), 60)
        return f"{minutes // 60}:{minutes % 60:02d}:{seconds:02d}"
    return datetime.fromtimestamp(time, UTC).strftime("%Y-%m-%d %H:%M:%S")


def facts_of(monitor: "Monitor", now: Reading) -> Facts:
    """All that is shown of a watch, as JSON can hold it: numbers that are not finite are None.

    Parameters
    ----------
    monitor : Monitor
    now : Reading
        What was read last.

    Returns
    -------
    dict
        ``time`` (s), ``tool``, ``work``, ``simulated``, ``state``, ``edge``, ``cut_minutes`` (contact of the edge),
        ``conditions``, ``loads``, ``wear``, ``life``, ``probability_past``, ``probability_past_after_next_cut``,
        ``decision``, ``advice``, ``alarms``, ``source``, ``notes``, ``journal`` and ``control``.
    """
    laws = monitor.laws
    conditions = dict(monitor.conditions or now.conditions)
    return {
        "schema": SCHEMA,
        "time": now.time,
        "clock": clock(now.time),
        "tool": monitor.identity.get("tool", ""),
        "work": monitor.identity.get("work", ""),
        "simulated": bool(monitor.identity.get("simulated")),
        "state": now.state,
        "edge": {"number": monitor.edge.number, "tool": monitor.edge.tool, "gauges": monitor.edge.gauges},
        "cut_minutes": monitor.edge.minutes + now.open,
        "conditions": dict(now.conditions) or conditions,
        "loads": _loads(monitor, now),
        "wear": {"symbol": laws.wear.symbol, "unit": laws.wear.unit, "criterion": monitor.estimate.criterion}
        | _wear(monitor, now, conditions),
        **_forecast(monitor, now, conditions),
        "decision": monitor.decisions[-1] if monitor.decisions else None,
        "advice": [*monitor.decisions, *now.advice],
        "alarms": [*monitor.alarms],
        "source": dict(now.source),
        "notes": [f"{clock(note['time'])} {note['text']}" for note in monitor.notes]
        + [*monitor.estimate.notes, *laws.unused],
        "journal": dict(now.journal),
        "control": dict(now.control),
    }


def _wear(monitor: "Monitor", now: Reading, conditions: Mapping[str, float]) -> Facts:
    """Interval of the wear; none of an edge that has not cut."""
    nothing = {"median": None, "low": None, "high": None, "level": monitor.settings.level}
    if monitor.uncounted > 0:
        return {**nothing, "reason": f"not known: {monitor.uncounted:.3g} min were cut at unknown conditions"}
    if far := monitor.laws.far(conditions):
        return {**nothing, "reason": f"not known: {', '.join(far)} far from the tests"}
    if monitor.edge.minutes + now.open <= 0:
        return {**nothing, "reason": "new edge, no contact yet"}
    return _interval(lambda: monitor.estimate.wear(monitor.settings.level, now.open, conditions), monitor)


def advice_of(monitor: "Monitor", bounds: "Bounds | None") -> list[Facts]:
    """Advice of feed and speed for the next cut; none where its length or its conditions are not known."""
    from .advice import advise

    minutes, asked = monitor.next_cut, monitor.settings
    unknown = any((monitor.distrusted, monitor.uncounted > 0, monitor.laws.far(monitor.conditions)))
    if unknown or bounds is None or not minutes or not monitor.conditions:
        return []
    try:
        lost = monitor.alarmed("load")
        found = advise(monitor.estimate, bounds, monitor.conditions, minutes, asked.risk, asked.costs, lost=lost)
    except FitmodelsError:
        return []
    return [
        {"time": monitor.time, "kind": one.kind, "text": one.text, "probability": one.probability,
         "settings": dict(one.settings)} for one in found
    ]  # fmt: skip


def _loads(monitor: "Monitor", now: Reading) -> Facts:
    """Last reading, mean of the last window and expected value of each load."""
    found = {}
    for name, law in monitor.laws.loads.items():
        expected, low, high = monitor.expected.get(name, (None, None, None))
        value = now.loads.get(name)
        mean = monitor.measured.get(name)
        found[name] = {"value": value, "unit": law.unit, "mean": mean, "expected": expected, "low": low, "high": high}
    return found


def _forecast(monitor: "Monitor", now: Reading, conditions: Mapping[str, float]) -> Facts:
    """Remaining life and probabilities, where the conditions are known and were throughout."""
    if not conditions or monitor.uncounted > 0 or monitor.laws.far(conditions):
        return {"life": None, "probability_past": None, "probability_past_after_next_cut": None}
    level, ahead = monitor.settings.level, monitor.next_cut
    life = _interval(lambda: monitor.estimate.life(conditions, level, now.open), monitor)
    past: float | None
    then: float | None
    try:
        past = float(monitor.estimate.probability_past(now.open, conditions))
        then = None if ahead is None else float(monitor.estimate.probability_past(now.open + ahead, conditions))
    except FitmodelsError:
        past = then = None
    return {
        "life": {**life, "unit": "min", "at": dict(conditions)},
        "probability_past": past,
        "probability_past_after_next_cut": then,
        "next_cut_minutes": ahead,
        "risk": monitor.settings.risk,
    }


def _interval(of: Any, monitor: "Monitor") -> Facts:  # noqa: ANN401
    """Median, low and high of an interval, None where they cannot be computed."""
    try:
        found = of()
    except FitmodelsError as reason:
        return {"median": None, "low": None, "high": None, "level": monitor.settings.level, "reason": str(reason)}
    ends = {name: getattr(found, name) for name in ("median", "low", "high")}
    beyond = {"reason": "the law reaches the criterion at no time that it can state"} if ends["median"] == inf else {}
    return {name: float(value) if isfinite(value) else None for name, value in ends.items()} | {
        "level": monitor.settings.level,
        **beyond,
    }
