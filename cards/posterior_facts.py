"""What is told of a posterior, once for screen and paper."""

from ..core.rounding import format_plain, format_rounded
from ..parameters import LawPosterior, LawSection, ParameterFile

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
