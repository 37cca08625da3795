"""The posterior of a law as a part of a card: priors, convergence, table, sentences."""

from ...core.rounding import format_plain, format_rounded
from ...parameters import LawSection, ParameterFile
from ...parameters.checks.values import ESS, K_HAT, R_HAT
from ...parameters.sections.posterior import LawPosterior, Prior
from .numbers import count, fact, number, percent, places, spread
from .parts import DrawnParameterPart, FactPart, PosteriorPart

AT_MIDDLE = (
    "The prior of the constant is set on what the law says at the middle of the tests, not on the constant itself."
)
ROWS = "sd is the scatter of rows."
EDGES = "sd is the scatter of rows within an edge, icc the share of the whole variance that lies between edges."


def posterior_part(law: LawSection, of: LawPosterior | None) -> PosteriorPart | None:
    """The posterior, its reason where there is none, None where nobody drew one."""
    if of is None:
        return None
    said = tuple(posterior_words(law, of))
    if of.reason is not None:
        return PosteriorPart(reason=of.reason, sentences=said)
    return PosteriorPart(
        method=of.words or of.method or "",
        priors=of.prior_set or "",
        gate=gate(of),
        level=percent(of.level),
        parameters=drawn_parameters(of),
        sentences=(*said, *_meaning(of), *([AT_MIDDLE] if of.level_at else [])),
    )


def gate(of: LawPosterior) -> tuple[FactPart, ...]:
    """The figures by which the draws were let through."""
    return (
        *fact("draws", count(of.draws)),
        *fact("R-hat", places(of.r_hat, 3), f"the largest of any parameter; the gate asks for at most {R_HAT:g}"),
        *fact("effective draws", places(of.ess, 0), f"the fewest of any parameter; the gate asks for at least {ESS:g}"),
        *(() if of.k_hat is None else fact(
            "k-hat", places(of.k_hat, 2), f"of the weights of the draws; the gate asks for at most {K_HAT:g}"
        )),
    )  # fmt: skip


def _meaning(of: LawPosterior) -> list[str]:
    """What is drawn beside the coefficients."""
    if "sd" not in of.parameters:
        return []
    return [EDGES if "icc" in of.parameters else ROWS]


def drawn_parameters(of: LawPosterior) -> tuple[DrawnParameterPart, ...]:
    """A line for each parameter that was drawn."""
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
                prior=prior_words(prior),
                moved="" if moves is None else f"{moves.halved:+.2f}, {moves.doubled:+.2f}",
            )
        )
    return tuple(lines)


def prior_words(prior: Prior | None) -> str:
    """A prior in a few words."""
    if prior is None:
        return ""
    n = prior.numbers
    match prior.distribution:
        case "normal":
            words = f"normal {n['mean']:.4g}, sd {n['sd']:.3g}"
        case "half-t":
            words = f"half-t({n['df']:g}), scale {n['scale']:.3g}"
        case "beta":
            words = "uniform" if n["a"] == n["b"] == 1 else f"beta {n['a']:g}, {n['b']:g}"
        case "gamma":
            words = f"gamma {n['shape']:g}, rate {n['rate']:g}"
        case _:
            words = "flat"
    return words + (f" {prior.unit}" if prior.unit not in ("", "1") and words != "flat" else "")


APART = 1.5  # standard error by edge over sd of the draws, beyond which it is said
MOVED = 0.2  # sd: what halving or doubling of priors may move without a word


def posterior_of(pf: ParameterFile, law: LawSection) -> LawPosterior | None:
    """The posterior of a law, where the file has one."""
    return None if pf.posterior is None else pf.posterior.laws.get(law.response)


def posterior_words(law: LawSection, of: LawPosterior | None) -> list[str]:
    """The posterior in at most three sentences: intervals, what priors do, where the jackknife is wider."""
    if of is None:
        return []
    if of.reason is not None:
        return [f"No posterior: {of.reason}."]
    shown = [
        f"{name} {format_rounded(p.low, p.sd)[0]} … {format_rounded(p.high, p.sd)[0]}"
        for name, p in of.parameters.items()
        if name in law.coefficients and not name.startswith("ln ")
    ]
    how = f"{of.method}, {of.draws} draws" + (", Student-t errors" if of.errors == "student" else "")
    said = [f"Posterior ({how}, {of.prior_set} priors): {100 * of.level:g} % credible {', '.join(shown)}."]
    if of.verified is not None:
        said.append(f"Checked by chains: {of.verified}.")
    return [*said, *wider(law, of), *_moved(of), *(f"Of the draws: {note}." for note in of.notes)]


def wider(law: LawSection, of: LawPosterior) -> list[str]:
    """Where single edges move the estimate more than a level of each edge explains."""
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
        f"The draws are too sure of {', '.join(wide)}: leaving out single edges moves {worst} "
        f"{format_plain(ratio[worst], 2)} times as much as they say, so rows of an edge hang together by more "
        "than its level. Take the interval by edge."
    ]


def _moved(of: LawPosterior) -> list[str]:
    """Parameters that the priors hold as much as the tests do."""
    moved = {name: max(abs(s.halved), abs(s.doubled)) for name, s in of.sensitivity.items()}
    held = [name for name, most in moved.items() if most > MOVED]
    if not held:
        return []
    worst = max(held, key=lambda name: moved[name])
    return [
        f"The priors speak with the tests: half or twice as wide they move {', '.join(held)} (most {worst}, by "
        f"{format_plain(moved[worst], 2)} of its sd); more tests, or priors of your own (--priors), settle it."
    ]
