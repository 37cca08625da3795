"""The terminal view of a watch: wear with its band, remaining life, loads, decision, alarms; and its plain lines."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final

from ..core.rounding import decimals, format_plain, format_probability
from ..core.text import one_line, printable
from .facts import Facts, clock

if TYPE_CHECKING:
    from rich.console import RenderableType

BAR: Final = 48  # characters of the gauge of wear
BEYOND: Final = 1.25  # end of the gauge, as a multiple of the criterion
LINE_EACH: Final = 60.0  # s of the source between two plain lines
STYLES: Final = {"change": "bold red", "go on": "green"}
NOTES: Final = 4
LEAST_LIFE: Final = 0.1  # min, whose decimals are shown of a shorter life
ADVICE: Final = 2  # lines


def screen(facts: Facts) -> "RenderableType":
    """The view of a terminal, at most 24 lines.

    Parameters
    ----------
    facts : dict
        Of `fitmodels.live.facts.facts_of`.
    """
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    pair = " on ".join(one_line(facts[name]) for name in ("tool", "work") if facts[name])
    head = Text(f"{pair}   edge {facts['edge']['number']}   {facts['clock']}   ", style="bold")
    head.append(facts["state"], style="bold reverse" if facts["state"] in ("lost", "stopped") else "bold")
    if facts["simulated"]:
        head.append("   simulated", style="not bold italic")
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", no_wrap=True)
    table.add_column()
    for alarm in facts["alarms"][-3:]:
        table.add_row(Text("ALARM", style="bold red"), Text(one_line(alarm["text"]), style="bold red"))
    for label, words in rows(facts):
        table.add_row(label, Text(one_line(words)))
    decision = facts["decision"]
    if decision is not None:
        table.add_row("decision", Text(one_line(decision["text"]), style=STYLES.get(decision["kind"], "")))
    for k, note in enumerate(facts["notes"][-NOTES:]):
        table.add_row("notes" if k == 0 else "", Text(one_line(note), style="dim"))
    return Group(head, table)


def rows(facts: Facts) -> list[tuple[str, str]]:
    """Label and text of each line of the view.

    Examples
    --------
    >>> wear = {"symbol": "VB", "unit": "mm", "median": 0.2, "low": 0.15, "high": 0.25, "level": 0.9, "criterion": 0.3}
    >>> wear_words(wear)
    'VB 0.200 mm, 90 % between 0.150 and 0.250; criterion 0.3 mm'
    """
    found = [("wear", wear_words(facts["wear"]))]
    if bar := gauge(facts["wear"]):
        found.append(("", bar))
    found.append(("life", life_words(facts["life"])))
    if (risk := risk_words(facts)) is not None:
        found.append(("risk", risk))
    for name, load in facts["loads"].items():
        found.append(("load", load_words(name, load)))
    if facts["conditions"]:
        found.append(("at", conditions_words(facts["conditions"])))
    found.append(("contact", f"{facts['cut_minutes']:.2f} min of this edge"))
    found += [("advice", one["text"]) for one in facts["advice"] if "settings" in one][:ADVICE]
    found.append(("source", source_words(facts["source"])))
    found.append(("control", facts["control"]["text"]))
    if facts["journal"]:
        journal = facts["journal"]
        fault = f"; NOT WRITTEN: {journal['fault']}" if journal.get("fault") else ""
        found.append(("journal", f"{journal['file']}, {journal['records']} records{fault}"))
    return found


def wear_words(wear: Facts) -> str:
    """Median and interval of the wear, and the criterion."""
    end = "" if wear["criterion"] is None else f"; criterion {format_plain(wear['criterion'])} {wear['unit']}"
    value = wear["reason"] if wear.get("reason") else _interval(wear, wear["unit"], 0.0)
    return f"{wear['symbol']} {value}{end}"


def life_words(life: Facts | None) -> str:
    """Median and interval of the remaining life."""
    if life is None:
        return "not known: conditions of cutting are not known"
    return _interval(life, "min of cutting left" if life["median"] is not None else "min", LEAST_LIFE)


def risk_words(facts: Facts) -> str | None:
    """Probability of being past the criterion, now and after the next cut."""
    now, then = facts["probability_past"], facts["probability_past_after_next_cut"]
    if now is None:
        return None
    ahead = (
        "" if then is None else f", after the next cut ({facts['next_cut_minutes']:.3g} min) {format_probability(then)}"
    )
    return f"probability of being past the criterion now {format_probability(now)}{ahead}"


def load_words(name: str, load: Facts) -> str:
    """Last reading, mean of the last window and expected value of a load."""
    unit = load["unit"]
    value = "no reading" if load["value"] is None else f"{load['value']:.4g} {unit} read"
    if load["expected"] is None:
        return f"{name} {value}"
    ends = _ends(load["low"], load["high"])
    window = f"window {load['mean']:.4g}, expected {load['expected']:.4g} ({ends}) {unit}"
    return f"{name} {value}; cutting load of the last {window}"


def conditions_words(conditions: Facts) -> str:
    """Conditions of a cut with their units.

    >>> conditions_words({"V": 120.0, "f": 0.2})
    'V 120 m/min, f 0.2 mm/rev'
    """
    from ..datasets.vocabulary import ROLES

    units = {name: role.unit for name, role in ROLES.items()}
    return ", ".join(f"{name} {value:.4g} {units.get(name, '')}".rstrip() for name, value in conditions.items())


def source_words(source: Facts) -> str:
    """Name and state of the source, and the age of its last reading where it is late."""
    age = f", last reading {source['age']:.0f} s ago" if source.get("age") is not None and source["age"] >= 2 else ""
    text = f": {source['text']}" if source.get("text") else ""
    return f"{source['name']} {source['state']}{text}{age}"


def gauge(wear: Facts, width: int = BAR) -> str:
    """A line of the wear: its interval, its median and the criterion; empty where one is not known.

    >>> gauge({"median": 0.2, "low": 0.15, "high": 0.25, "criterion": 0.3}, 30)
    '0 -----------=====#====--|------ 0.375'
    """
    if wear["median"] is None or wear["criterion"] is None or wear["low"] is None or wear["high"] is None:
        return ""
    end = wear["criterion"] * BEYOND
    at = {name: min(int(wear[name] / end * width), width - 1) for name in ("low", "median", "high", "criterion")}
    line = ["-"] * width
    for place in range(at["low"], at["high"] + 1):
        line[place] = "="
    line[at["criterion"]] = "|"
    line[at["median"]] = "#"
    return f"0 {''.join(line)} {format_plain(end)}"


def _interval(of: Facts, unit: str, least: float) -> str:
    if of["median"] is None:
        return f"not known{': ' + of['reason'] if of.get('reason') else ''}"
    if of["low"] is None:
        return f"{format_plain(of['median'])} {unit}"
    if of["high"] is None:
        return f"{format_plain(of['median'])} {unit}, {of['level'] * 100:.0f} % above {format_plain(of['low'])}"
    low, median, high = _rounded(of, least)
    return f"{median} {unit}, {of['level'] * 100:.0f} % between {low} and {high}"


def _rounded(of: Facts, least: float) -> list[str]:
    """Low end, median and high end with the decimals of a quarter of the interval, or of the least value shown.

    >>> _rounded({"low": 0.0, "median": 0.0, "high": 0.0}, 1.0), _rounded({"low": 4.0, "median": 7.0, "high": 9}, 0.0)
    (['0.0', '0.0', '0.0'], ['4.0', '7.0', '9.0'])
    """
    quarter = max((of["high"] - of["low"]) / 4, 1e-4 * of["high"], least)
    places = max(0, decimals(quarter or 1.0))
    return [f"{of[name]:.{places}f}" for name in ("low", "median", "high")]


def _short(of: Facts, least: float = 0.0) -> str:
    """Median and interval in brackets."""
    if of["median"] is None:
        return "not known"
    if of["low"] is None or of["high"] is None:
        return format_plain(of["median"])
    low, median, high = _rounded(of, least)
    return f"{median} ({low} to {high})"


def _ends(low: float | None, high: float | None) -> str:
    return "no interval" if low is None or high is None else f"{low:.4g} to {high:.4g}"


class PlainLines:
    """Lines of a watch where the output is no terminal: what is new, and the state each minute of the source.

    Parameters
    ----------
    write : callable
        Prints a line.
    """

    def __init__(self, write: Callable[[str], None]) -> None:
        self._write = write
        self._next: float | None = None

    def show(self, facts: Facts) -> None:
        """Do nothing: lines follow the clock of the source."""

    def report(self, facts: Callable[[], Facts], sentences: Sequence[str], time: float | None) -> None:
        """Print new sentences, and the state where a minute has passed."""
        for sentence in sentences:
            self._write(f"{clock(time)}  {one_line(sentence)}")
        if time is not None and (self._next is None or time >= self._next or time < self._next - 10 * LINE_EACH):
            self._next = time + LINE_EACH
            self._write(self.line(facts()))

    def line(self, facts: Facts) -> str:
        """The state on one line."""
        wear, life = facts["wear"], facts["life"]
        parts = [f"{facts['clock']}  {facts['state']:<8} {facts['cut_minutes']:5.2f} min"]
        known = f"{_short(wear)} {wear['unit']}" if wear["median"] is not None else str(wear.get("reason", "not known"))
        parts.append(f"{wear['symbol']} {known}")
        if life is not None and life["median"] is not None:
            parts.append(f"life {_short(life, LEAST_LIFE)} min")
        if facts["probability_past"] is not None:
            parts.append(f"past {format_probability(facts['probability_past'])}")
        return printable("  ".join(parts))

    def close(self) -> None:
        """End."""


class ScreenView:
    """The view of a terminal, renewed in place.

    Parameters
    ----------
    live : rich.live.Live
        Started.
    """

    def __init__(self, live: Any) -> None:  # noqa: ANN401
        self._live = live

    def show(self, facts: Facts) -> None:
        """Renew the view."""
        self._live.update(screen(facts), refresh=True)

    def report(self, facts: Callable[[], Facts], sentences: Sequence[str], time: float | None) -> None:
        """Renew the view where something is new."""
        if sentences:
            self.show(facts())

    def close(self) -> None:
        """Leave the last view on the terminal."""
        self._live.stop()
