"""What the results of this room say of themselves: one function a result, from result to `Telling`."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..datasets.rounding import decimals, p_value, plain
from ..datasets.telling import Grid, Telling, estimates, in_line, measured, with_unit
from .available import NotAvailable

if TYPE_CHECKING:
    import pandas as pd

    from .bayes.posterior import Posterior
    from .bayes.priors import Priors
    from .beside import Beside
    from .bootstrap import EdgeBootstrap
    from .checks.check import Check
    from .checks.forms import Forms
    from .checks.refit import Refit
    from .composite import Composite
    from .confirm import Confirmation
    from .domain import Domain
    from .edges import EdgeInference
    from .lawfit import LawFit
    from .life import ToolLife
    from .linear import LinearFit

CONCERN = ("fine", "mind", "serious")


def equation(law: "LawFit") -> str:
    """The law with its coefficients, each rounded by its standard error."""
    params, bse = law.params, law.bse
    c = [_rounded(float(v), float(s)) for v, s in zip(params, bse, strict=True)][: 1 + len(law.factors)]
    left = with_unit(law.response, law.units.get(law.response, ""))
    if law.form == "power":
        return " ".join([f"{left} = {c[0]}", *(f"{x}^{k}" for x, k in zip(law.factors, c[1:], strict=True))])
    if law.form == "exponential":
        return f"{left} = {c[0]} exp({c[1]} {law.factors[0]})"
    signed = (f"{'-' if k[0] == '-' else '+'} {k.lstrip('-')} {x}" for x, k in zip(law.factors, c[1:], strict=True))
    return " ".join([f"{left} = {c[0]}", *signed])


def of_law(law: "LawFit") -> Telling:
    """Equation, R2, residual standard error and rows; the coefficients with their intervals."""
    se, ends = law.scale_se, law.conf_int()
    rows = f"{law.nobs} rows" + ("" if law.n_edges is None else f" of {law.n_edges} edges")
    scatter = f"residual SE {plain(se, 3)} {law.scale_unit}".rstrip() if se is not None else str(law.no_interval)
    more = {"t": [_number(v) for v in law.tvalues], "p": [p_value(float(v)) for v in law.pvalues]}
    by = "by edge" if not isinstance(law.edges, NotAvailable) else "rows taken as independent"
    facts = (("form", f"{law.form.replace('_', ' ')}, {law.error} errors"), ("standard errors", f"{by}, df {law.df}"))
    words = [f"Left out: {item.factor}, {item.reason}." for item in law.left_out] + list(law.notes)
    return Telling(
        f"{equation(law)}, R2 {law.rsquared:.3f}, {scatter}, {rows}",
        facts,
        estimates(law.names, law.params, law.bse, list(ends["low"]), list(ends["high"]), more=more),
        tuple(words),
    )


def of_linear(fit: "LinearFit") -> Telling:
    """Rows, R2 and residual standard error; the coefficients."""
    names = [f"x{j}" for j in range(len(fit.params))]
    head = f"{len(names)} coefficients from {fit.nobs} rows, R2 {fit.rsquared:.3f}"
    return Telling(f"{head}, residual SE {plain(fit.scale**0.5)}", grid=estimates(names, fit.params, fit.bse))


def of_edges(edges: "EdgeInference") -> Telling:
    """Edges, share of the variance between them, what repeated rows did to F; the standard errors."""
    grew = "" if edges.inflation is None else f", F of rows {plain(edges.inflation, 3)} times that of edges"
    grid = Grid(("", "se by edge", "told by"), tuple(
        (name, plain(float(se), 2), "rows of an edge" if within else "edges")
        for name, se, within in zip(edges.names, edges.bse, edges.within, strict=True)
    ))  # fmt: skip
    return Telling(
        f"{edges.n_edges} edges, df {edges.df}, {edges.icc:.0%} of the scatter between edges{grew}", (), grid
    )


def of_bootstrap(found: "EdgeBootstrap") -> Telling:
    """How many refits, and the interval of each coefficient."""
    ends = found.interval()
    lost = f", {found.impossible} draws of edges fixed no law" if found.impossible else ""
    grid = estimates(found.names, found.draws.mean(axis=0), found.bse, list(ends["low"]), list(ends["high"]))
    return Telling(f"{len(found.draws)} refits to edges drawn with replacement{lost}", (), grid)


def of_draws(head: str, table: "pd.DataFrame", words: Sequence[str] = ()) -> Telling:
    """Draws of parameters: mean, sd, interval, R-hat and effective draws of each."""
    least = np.minimum(table["ess_bulk"], table["ess_tail"])
    more = {"r_hat": [f"{v:.3f}" for v in table["r_hat"]], "ess": [f"{v:.0f}" for v in least]}
    grid = estimates(list(table.index), table["mean"], table["sd"], list(table["low"]), list(table["high"]), more=more)
    return Telling(head, (), Grid(("", "mean", "sd", *grid.header[3:]), grid.rows), tuple(words))


def of_posterior(post: "Posterior") -> Telling:
    """Draws and route, the gate, the parameters."""
    names = ", ".join(
        f"{name} {measured(float(m), float(s))}"
        for name, m, s in zip(post.names, post.draws.mean(axis=0), post.draws.std(axis=0, ddof=1), strict=True)
    )
    gate = post.gate
    state = "gate open" if gate.open else "gate SHUT"
    head = f"{post.response}, {len(post.draws)} {post.method} draws, {state}: {names}"
    return of_draws(head, post.table(), (*gate.reasons, *post.notes))


def of_priors(priors: "Priors") -> Telling:
    """Name, and what each parameter was taken to be."""
    rows = tuple(
        (
            name,
            f"{prior.name} {prior._telling().head}".strip(),
            priors.units.get(name, ""),
            priors.sources.get(name, ""),
        )
        for name, prior in priors.of.items()
    )
    proper = "proper" if priors.proper else "improper"
    return Telling(
        f"{priors.name}, {proper}, of {', '.join(priors.of)}", (), Grid(("", "prior", "unit", "source"), rows)
    )


def of_life(life: "ToolLife") -> Telling:
    """Life as an equation, at the middle of the tests, and Taylor's n."""
    c0, *powers = life.coefficients.items()
    told = " ".join([plain(float(c0[1])), *(f"{name}^{plain(float(k), 3)}" for name, k in powers)])
    head = f"{life.wear} reaches {life.criterion:g} {life.unit_of_wear} after T [{life.unit}] = {told}"
    at = in_line((name, plain(value)) for name, value in life.typical_at.items())
    facts = [
        (f"at {at}", f"{plain(life.typical, 3)} {life.unit}"),
        ("longest test", f"{life.t_observed:g} {life.unit}"),
    ]
    if life.taylor_n is not None:
        facts.append(("Taylor's n", plain(life.taylor_n, 3)))
    errors = [None] * len(life.coefficients) if life.bse is None else list(life.bse)
    grid = estimates([str(name) for name in life.coefficients.index], life.coefficients, errors)
    return Telling(f"{head}; {plain(life.typical, 3)} {life.unit} at {at}", tuple(facts), grid)


def of_checks(checks: Mapping[str, "Check | NotAvailable"], verdicts: Sequence[str], nobs: int) -> Telling:
    """How many checks found something, the worst first; each check on a row."""
    there = {name: check for name, check in checks.items() if not isinstance(check, NotAvailable)}
    worst = sum(check.concern > 0 for check in there.values())
    rows = tuple(
        (name, "not known", "", check.reason) if isinstance(check, NotAvailable)
        else (name, CONCERN[min(check.concern, 2)], "" if check.pvalue is None else p_value(check.pvalue), check.brief)
        for name, check in checks.items()
    )  # fmt: skip
    head = f"{len(there)} checks on {nobs} rows, {worst} with something to mind"
    return Telling(f"{head}. {verdicts[0]}" if verdicts else head, (), Grid(("", "", "p", ""), rows), tuple(verdicts))


def frame_of_checks(checks: Mapping[str, "Check | NotAvailable"]) -> "pd.DataFrame":
    """A row a check; of one that cannot be had, the reason."""
    import pandas as pd

    rows = {
        name: (None, None, None, check.reason)
        if isinstance(check, NotAvailable)
        else (check.concern, check.statistic, check.pvalue, check.verdict)
        for name, check in checks.items()
    }
    return pd.DataFrame.from_dict(rows, orient="index", columns=["concern", "statistic", "pvalue", "verdict"])


def of_refit(fit: "Refit", verdict: str) -> Telling:
    """The verdict; both fits side by side."""
    errors = np.sqrt(np.diag(fit.law.covariance()))
    plainly = [measured(float(v), float(s)) for v, s in zip(fit.law.theta, errors, strict=True)]
    again = [measured(float(v), float(s)) for v, s in zip(fit.theta, fit.bse, strict=True)]
    rows = tuple(zip(fit.law.theta_names, plainly, again, strict=True))
    return Telling(verdict, (), Grid(("", "plain fit", "this fit"), rows))


def of_composite(found: "Composite") -> Telling:
    """The verdict and the law without its wear."""
    return Telling(
        found.verdict, (), estimates(found.names, found.theta, found.bse), (f"It assumes {found.assumption}.",)
    )


def of_confirmation(found: "Confirmation") -> Telling:
    """The verdict; each edge."""
    return Telling(found.verdict, (), of_frame(found.edges))


def of_domain(domain: "Domain") -> Telling:
    """The range of each factor."""
    centre, half = np.array(domain.centre), np.array(domain.half_range)
    low, high, middle = centre - half, centre + half, centre
    if domain.logs:
        low, high, middle = np.exp(low), np.exp(high), np.exp(middle)
    told = [
        (plain(float(a), 4), plain(float(m), 4), plain(float(b), 4)) for a, m, b in zip(low, middle, high, strict=True)
    ]
    names = list(zip(domain.factors, domain.units, strict=True))
    head = ", ".join(f"{x} {a} to {b} {u}".rstrip() for (x, u), (a, _, b) in zip(names, told, strict=True))
    rows = tuple((with_unit(x, u), *ends) for (x, u), ends in zip(names, told, strict=True))
    radius = (("largest coded radius", plain(domain.largest_radius, 3)),)
    return Telling(f"{domain.response} was tested at {head}", radius, Grid(("", "low", "middle", "high"), rows))


def of_beside(found: "Beside") -> Telling:
    """The printed law and how far the rows lie from it."""
    law = in_line((name, plain(value)) for name, value in found.coefficients.items())
    far = "" if found.rms_percent is None else f"; rows lie {plain(found.rms_percent, 3)} % from it (rms)"
    if found.worst_percent is not None:
        far += f", at most {plain(found.worst_percent, 3)} % (line {found.worst_line})"
    return Telling(f"{found.source}: {law}{far}")


def of_forms(found: "Forms") -> Telling:
    """The argument; each form with its error of foretelling."""
    rows = tuple((form.name, plain(form.error, 3), plain(form.difference, 2), plain(form.standard_error, 2))
                 for form in (found.power, *found.rivals))  # fmt: skip
    words = tuple(f"{name}: {reason}." for name, reason in found.not_fitted)
    return Telling(found.argument, (), Grid(("", f"error left out, by {found.unit}", "difference", "se"), rows), words)


def of_frame(frame: "pd.DataFrame", most: int = 12) -> Grid:
    """A frame as a grid of plain numbers, its first rows where it is long."""
    rows = tuple(
        (str(name), *(_cell(value) for value in row))
        for name, row in zip(frame.index[:most], frame.head(most).itertuples(index=False), strict=True)
    )
    return Grid(("", *map(str, frame.columns)), rows)


def _cell(value: Any) -> str:  # noqa: ANN401
    return plain(float(value)) if isinstance(value, float) else str(value)


def _number(value: float) -> str:
    return plain(value, 3) if np.isfinite(value) else ""


def _rounded(value: float, se: float) -> str:
    """To the decimals of the standard error; a number whose error is unknown or nothing to four digits."""
    places = decimals(se) if np.isfinite(se) and se > 1e-5 * abs(value) else 7
    return plain(value) if not 0 <= places <= 6 or abs(value) < se else f"{value:.{places}f}"
