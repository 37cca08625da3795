"""Display of economic settings: a table, then sentences on limits, comparison, change of edges and assumptions."""

from collections.abc import Iterator

from ...core.display import Display, TextTable, display_of
from ...core.rounding import format_plain
from .optimum import EconomicSettings, PricedSetting

SMALL = 1e-4  # of the cost: a loss by not knowing the laws that is not worth a test


@display_of.register
def of_economic_settings(found: EconomicSettings) -> Display:
    """The settings of least cost and of greatest rate, and today's."""
    of, currency = found.costs.of, found.costs.currency
    best = found.least_cost
    head = (
        f"calculated, cost of a {of} at d {found.setting.d:g} mm, {found.source.words}: least "
        f"{format_plain(best.cost)} {currency} at V {best.V:.4g} m/min, f {best.f:.3g} mm/rev"
        f"{', outside the tests' if best.beyond else ''}"
    )
    named = {
        "least cost": best, "greatest rate": found.greatest_rate, "least within tests": found.tested,
        "today": found.today,
    }  # fmt: skip
    shown = {name: setting for name, setting in named.items() if setting is not None}
    header = ("", *shown)
    rows = [
        (f"{what}, {unit}", *(_cell(setting, name, digits) for setting in shown.values()))
        for what, name, unit, digits in (
            ("V", "V", "m/min", 4), ("f", "f", "mm/rev", 3), ("tool life", "life", "min", 3),
            (f"time per {of}", "time", "min", 4), (f"cost per {of}", "cost", currency, 4),
        )
    ]  # fmt: skip
    return Display(head, (), TextTable(header, tuple(rows)), tuple(_sentences(found, shown)))


def _cell(setting: PricedSetting, name: str, digits: int) -> str:
    value = format_plain(getattr(setting, name), digits)
    if name not in setting.bands:
        return value
    low, high = (format_plain(end, digits) for end in setting.bands[name])
    return f"{value} ({low} … {high})" if low != high else value


def _sentences(found: EconomicSettings, shown: dict[str, PricedSetting]) -> Iterator[str]:
    costs, best = found.costs, found.least_cost
    parts = ", ".join(f"{name} {format_plain(value, 3)}" for name, value in best.parts.items())
    yield f"Cost per {costs.of} at the least-cost setting, {costs.currency}: {parts}."
    for name, setting in shown.items():
        yield from _limits(name, setting)
    if best.beyond and found.tested is None:
        yield "No pair within the limits was found inside the tested region of the laws."
    if costs.cut is not None:
        yield f"At the least-cost setting one edge cuts {format_plain(best.per_edge, 3)} parts in its life."
    yield from _comparison(found)
    yield from _change(found)
    yield from found.notes
    if found.draws:
        yield (
            f"In brackets: {found.level:.0%} intervals of the optimum, and of life, time and cost at the setting, from "
            f"{found.draws} draws of the laws' coefficients; single edges scatter more."
        )
    else:
        yield "No intervals: the laws of the file have no uncertainty."
    yield "Limits hold for a worn edge. Not included: scrap, setting up, purchase of the machine."


def _limits(name: str, setting: PricedSetting) -> Iterator[str]:
    if setting.exceeds:
        yield f"{name.capitalize()} exceeds the limits {', '.join(setting.exceeds)} with a worn edge."
    elif setting.held_by:
        yield f"{name.capitalize()}: limited by {' and '.join(setting.held_by)}."
    if setting.beyond:
        beyond = "; ".join(setting.beyond)
        yield f"{name.capitalize()} lies outside the tests: {beyond}. Extrapolated: test there before relying on it."


def _comparison(found: EconomicSettings) -> Iterator[str]:
    costs = found.costs
    if found.saving is not None:
        saving, low, high = found.saving
        band = f" ({found.level:.0%} interval {low:.3g} … {high:.3g})" if found.draws else ""
        cost = f"{abs(saving):.3g} {costs.currency} {'less' if saving >= 0 else 'more'} per {costs.of}"
        yield f"The least-cost setting costs {cost} than today's{band}."
    if found.not_knowing is not None:
        yield _not_knowing(found, found.not_knowing)


def _not_knowing(found: EconomicSettings, cost: float) -> str:
    """The sentence on the cost of coefficients that are not known exactly, per part."""
    small, amount = cost < SMALL * found.least_cost.cost, f"{cost:.2g} {found.costs.currency} per {found.costs.of}"
    if found.least_cost.beyond:
        lost = f"less than {SMALL:.2%} of the cost" if small else amount
        return (
            f"If the laws held outside the tests, not knowing their coefficients exactly would cost {lost} on average; "
            "whether they hold there, only tests at this setting show."
        )
    if small:
        return (
            "With the limits as estimated the best pair is the same in nearly all draws of the tool life: a more exact "
            "life would not change it."
        )
    return f"Not knowing the laws exactly costs {amount} on average: further tests are worth no more than that."


def _change(found: EconomicSettings) -> Iterator[str]:
    change, costs = found.change, found.costs
    if change is None:
        return
    if not change.planned_change:
        yield "Run every edge to its wear criterion: a planned change before it saves nothing at these costs."
        return
    whole = int(change.time / found.least_cost.cut * (1 + 1e-9))
    parts = f" ({whole} parts)" if costs.cut is not None else ""
    yield (
        f"Change edges after {format_plain(change.time, 3)} min in cut{parts}: {change.failed:.1%} of edges fail "
        f"before; changes and failures then cost {format_plain(change.cost, 3)} {costs.currency} per min in cut, "
        f"{format_plain(change.to_failure, 3)} if every edge runs to failure."
    )
    if costs.cut is not None and whole == 0:
        yield "One part takes longer than that: change the edge within the part, or cut it more slowly."
