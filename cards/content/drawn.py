"""Table of drawn parameters: median, sd, interval, prior, and how far other widths of the priors move them."""

from ...parameters import LawPosterior, Prior
from .numbers import number, spread
from .parts import DrawnParameter


def drawn_parameters(of: LawPosterior) -> tuple[DrawnParameter, ...]:
    """A line for each parameter that was drawn."""
    lines = []
    for name, p in of.parameters.items():
        moves = of.sensitivity.get(name)
        prior = of.priors.get("level" if name.startswith("ln ") or name == next(iter(of.parameters)) else name)
        lines.append(
            DrawnParameter(
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
