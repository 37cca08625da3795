"""The posterior of a law as a part of a card: priors, convergence, table, sentences."""

from ...core.rounding import format_plain, format_rounded
from ...parameters import LawSection, ParameterFile
from ...parameters.checks.values import ESS, K_HAT, R_HAT
from ...parameters.sections.posterior import LawPosterior, Prior
from .numbers import count, fact, number, percent, places, spread
from .parts import DrawnParameterPart, FactPart, PosteriorPart

APART = 1.5  # ratio of the standard error by edge to the posterior SD, above which it is reported
MOVED = 0.2  # shift in posterior SD by priors of half or double width, above which it is reported
# explanations of the table of parameters
ROWS = "sd is the standard deviation of rows."
EDGES = "sd is the standard deviation of rows within an edge, icc the intraclass correlation of edges."
AT_MIDDLE = "The prior of the constant is set on the response at the middle of the tests, not on the constant itself."
SHIFT = "Prior sensitivity is the shift in posterior SD with priors of half and of double width."
EXPLANATIONS = (ROWS, EDGES, AT_MIDDLE, SHIFT)


def posterior_of(pf: ParameterFile, law: LawSection) -> LawPosterior | None:
    """The posterior of a law, where the file has one."""
    return None if pf.posterior is None else pf.posterior.laws.get(law.response)


def posterior_part(law: LawSection, of: LawPosterior | None) -> PosteriorPart | None:
    """The posterior, its reason where there is none, None where none was drawn."""
    if of is None:
        return None
    if of.reason is not None:
        return PosteriorPart(reason=of.reason, sentences=(f"No posterior: {of.reason}.",))
    explained = [] if "sd" not in of.parameters else [EDGES if "icc" in of.parameters else ROWS]
    return PosteriorPart(
        method=of.words or of.method or "",
        priors=of.prior_set or "",
        gate=_convergence(of),
        level=percent(of.level),
        parameters=_parameters(of),
        sentences=(
            *_sentences(law, of),
            *explained,
            *([AT_MIDDLE] if of.level_at else []),
            *([SHIFT] if of.sensitivity else []),
        ),
    )


def wider(law: LawSection, of: LawPosterior) -> list[str]:
    """Parameters whose standard error by edge is far above the posterior SD, in at most one sentence."""
    ratio = {
        name: se / of.parameters[name].sd
        for name, se in of.jackknife.items()
        if name in law.coefficients and name in of.parameters and of.parameters[name].sd > 0
    }
    wide = [name for name, r in ratio.items() if r > APART]
    if not wide:
        return []
    worst = max(wide, key=lambda name: ratio[name])
    return [
        f"The posterior of {', '.join(wide)} is too narrow: the standard error by edge of {worst} is "
        f"{format_plain(ratio[worst], 2)} times the posterior SD, so rows of an edge are correlated beyond a random "
        "intercept. Use the cluster-robust interval."
    ]


def _sentences(law: LawSection, of: LawPosterior) -> list[str]:
    """Intervals, discrepancy from inference by edge, prior sensitivity, notes."""
    shown = [
        f"{name} {format_rounded(p.low, p.sd)[0]} … {format_rounded(p.high, p.sd)[0]}"
        for name, p in of.parameters.items()
        if name in law.coefficients and not name.startswith("ln ")
    ]
    how = f"{of.method}, {of.draws} draws" + (", Student-t errors" if of.errors == "student" else "")
    level = f"{100 * of.level:g} %"
    sentences = [f"Posterior ({how}, {of.prior_set} priors): {level} credible intervals {', '.join(shown)}."]
    if of.verified is not None:
        sentences.append(f"Verified by MCMC: {of.verified}.")
    return [*sentences, *wider(law, of), *_prior_sensitivity(of), *(f"Posterior: {note}." for note in of.notes)]


def _prior_sensitivity(of: LawPosterior) -> list[str]:
    moved = {name: max(abs(s.halved), abs(s.doubled)) for name, s in of.sensitivity.items()}
    held = [name for name, most in moved.items() if most > MOVED]
    if not held:
        return []
    worst = max(held, key=lambda name: moved[name])
    return [
        f"Prior sensitivity: priors of half or double width shift {', '.join(held)} (at most {worst}, by "
        f"{format_plain(moved[worst], 2)} posterior SD); more tests, or priors of your own (--priors), reduce this."
    ]


def _convergence(of: LawPosterior) -> tuple[FactPart, ...]:
    """Diagnostics of the draws with their limits."""
    return (
        *fact("draws", count(of.draws)),
        *fact("R-hat", places(of.r_hat, 3), f"largest of all parameters, limit {R_HAT:g}"),
        *fact("effective draws", places(of.ess, 0), f"smallest of all parameters, at least {ESS:g}"),
        *(() if of.k_hat is None else fact("k-hat", places(of.k_hat, 2), f"of the weights, limit {K_HAT:g}")),
    )


def _parameters(of: LawPosterior) -> tuple[DrawnParameterPart, ...]:
    """A line for each parameter: median, SD, interval, prior, prior sensitivity."""
    lines = []
    for name, p in of.parameters.items():
        moves = of.sensitivity.get(name)
        prior = of.priors.get("level" if name.startswith("ln ") or name == next(iter(of.parameters)) else name)
        lines.append(
            DrawnParameterPart(
                name=name,
                median=number(p.median, p.sd),
                sd=spread(p.median, p.sd),
                low=number(p.low, p.sd),
                high=number(p.high, p.sd),
                prior=_prior_words(prior),
                moved="" if moves is None else f"{moves.halved:+.2f}, {moves.doubled:+.2f}",
            )
        )
    return tuple(lines)


def _prior_words(prior: Prior | None) -> str:
    """A prior in a few words."""
    if prior is None:
        return ""
    n = prior.numbers
    match prior.distribution:
        case "normal":
            words = f"normal {n['mean']:.4g}, SD {n['sd']:.3g}"
        case "half-t":
            words = f"half-t({n['df']:g}), scale {n['scale']:.3g}"
        case "beta":
            words = "uniform" if n["a"] == n["b"] == 1 else f"beta {n['a']:g}, {n['b']:g}"
        case "gamma":
            words = f"gamma {n['shape']:g}, rate {n['rate']:g}"
        case _:
            words = "flat"
    return words + (f" {prior.unit}" if prior.unit not in ("", "1") and words != "flat" else "")
