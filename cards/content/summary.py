"""A card in a sentence or two: what an engineer would ask first."""

from typing import Any

from ...core.errors import ParameterError
from ...parameters import LawSection, ParameterFile
from .middle import at_words, middle, reference
from .numbers import figure, number, percent, quantity


def title(pf: ParameterFile) -> str:
    """Tool on work."""
    return f"{pf.identity.tool} on {pf.identity.work}"


def summary(pf: ParameterFile) -> str:
    """What the file holds and from how much, then the first number of it; that it is simulated before all."""
    simulated = "Not measured, simulated: " if pf.identity.simulated else ""
    what = join_words(_holds(pf)) or "no law, no dynamics and no settings yet"
    first = f"{simulated}{what}, for {title(pf)}{_from(pf)}."
    return " ".join([first[:1].upper() + first[1:], *_said(pf)])


def _holds(pf: ParameterFile) -> list[str]:
    laws = [f"{law.quantity} {law.response}" for law in pf.laws.values()]
    said = [("law of " if len(laws) == 1 else "laws of ") + join_words(laws)] if laws else []
    said += [f"a dynamic model of {pf.dynamics.output} from {pf.dynamics.input}"] if pf.dynamics else []
    said += ["PI gains"] if pf.pi else []
    said += [name for name, section in (
        ("settings of constant load", pf.load_line),
        ("settings of constant roughness", pf.roughness),
        ("settings of adaptive force", pf.adaptive_force),
    ) if section]  # fmt: skip
    return said


def _from(pf: ParameterFile) -> str:
    rows = [law.n for law in pf.laws.values()]
    edges = max((law.n_edges or 0 for law in pf.laws.values()), default=0)
    if not rows:
        return ""
    count = f"{max(rows)}" if min(rows) == max(rows) else f"{min(rows)} to {max(rows)}"
    return f", from {count} rows" + (f" of {edges} edges" if edges else "")


def _said(pf: ParameterFile) -> list[str]:
    """The first law at the middle of its tests, or the gains."""
    law = next(iter(pf.laws.values()), None)
    if law is not None:
        return [_of_law(law)]
    pi = pf.pi
    if pi is not None:
        return [
            f"Kp {figure(pi.kp, 4).text}, Ki {figure(pi.ki, 4).text} per second, sampled every {pi.sample_time:g} s."
        ]
    d = pf.dynamics
    if d is not None and d.held_out_fit is not None:
        return [f"A free run explains {d.held_out_fit:.1f} % of samples it was not fitted to."]
    return []


def _of_law(law: LawSection) -> str:
    at: dict[str, Any] = dict(middle(law))
    by = reference(law)
    where = f"At {at_words(law, at, by)}" if at else "At these conditions"
    try:
        p = law.tell("prediction", by=by, **at)
    except ParameterError:
        return f"{where}, {law.response} is {quantity(figure(float(law.predict(by, **at)), 4, law.unit))}."
    half = (float(p.high) - float(p.low)) / 2
    width = min(half, float(p.low)) if p.low > 0 else half
    value, low, high = (number(float(x), width, law.unit) for x in (p.value, p.low, p.high))
    new = "on a further edge" if p.edge == "new" else "in one further row"
    return (
        f"{where}, {law.response} is {quantity(value)}; {new} expect {low.text} to {quantity(high)} "
        f"({percent(p.level).text} %)."
    )


def join_words(names: list[str]) -> str:
    """``a, b and c``.

    >>> join_words(["a", "b", "c"]), join_words(["a"]), join_words([])
    ('a, b and c', 'a', '')
    """
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else "".join(names)
