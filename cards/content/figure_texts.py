"""Figures of a card with captions and text alternatives: drawn from the file, or pictures in its folder."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...datasets.vocabulary import FLANK_WEAR
from ...parameters import LawSection, ParameterFile
from ...parameters.sections.dynamics import DynamicsSection, PiSection
from ...parameters.sections.load_line import LimitsSection
from .design import at_words, middle, reference
from .numbers import INFINITE, figure, percent, quantity
from .parts import CoefficientPart, FigurePart, LawPart, ProfiledLawPart
from .profiler import Value, band_of, profile, profiled, substituted_wear

FOLDER = "figures"
PICTURES = {  # written to the folder of a card by fitmodels
    "response_surfaces": "Response surfaces: each law over its first two factors, tested settings as dots",
    "observed_predicted": "Observed against predicted values, one panel for each law",
    "residuals": "Residuals of the fit",
    "simulated": "Measured output, simulation of the model, and their difference",
    "bode": "Bode diagram of the model with bands, and the measured frequency response",
    "step": "Response of the model to a step of the input, with its 95 % band",
    "poles_zeros": "Poles and zeros of the model and of draws of it",
    "structure": "Candidate structures: simulation fit over order and delay, and criterion of the best",
    "step_response": "Measured output and fitted step response",
    "drive": "Measured speed, and simulation from the force alone",
    "force_process": "Measured force, and simulation from the feed command alone",
    "pi": "Map of the PI gains, and step response with the chosen gains",
}
EXPONENTS = "Exponents of the power laws with their 95 % intervals"
RESPONSES = "Each law over its first factor{}, with the band of {} (95 %)"
OWN, HELD = "{} from its own law", "{} held at {}"
SURFACES = "Each law over its first two factors, inside the tested region alone; limits dashed"
DYNAMICS = "Bode diagram of the identified model"
LOOP = "Step response of the closed loop: these gains on the identified model"


def figures(pf: ParameterFile, laws: Sequence[LawPart], folder: Path | None = None) -> tuple[FigurePart, ...]:
    """Figures that can be drawn from the file and its laws as parts, then pictures in ``folder/figures``, by name."""
    return (*_drawn(pf, laws), *_pictures(pf, folder))


def limits_of(pf: ParameterFile) -> dict[str, tuple[float, str]]:
    """Limits of the responses of the laws, with their words: the wear criterion, and those of the file.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> limits_of(parameters.collect(tool="GC435", work="709M40", limits={"power": 7}))
    {}
    """
    law_units = {symbol: law.unit for symbol, law in pf.laws.items()}
    return {
        symbol: (value, f"{words} {value:.4g} {unit}".rstrip())
        for symbol, value, unit, words in (*_criterion(pf), *_limits(pf))
        if value is not None and law_units.get(symbol) == unit
    }


def _criterion(pf: ParameterFile) -> Iterator[tuple[str, float | None, str, str]]:
    """The wear criterion of the design, and that of the tool life."""
    if pf.design is not None and (one := pf.design.criterion) is not None:
        yield one.wear, one.value, one.unit, "criterion"
    if (life := pf.tool_life) is not None:
        yield life.wear, life.criterion, life.unit_of_wear, "criterion"


def _limits(pf: ParameterFile) -> Iterator[tuple[str, float | None, str, str]]:
    """Limits of machine and tool by the symbols of the responses; the upper one where there are two."""
    limits = pf.limits or LimitsSection()
    bounds = [("P", limits.power), ("", limits.force), *((symbol, limits.wear) for symbol in FLANK_WEAR)]
    for symbol, bound in bounds:
        if bound is not None:
            yield bound.of or symbol, bound.value, bound.unit, "limit"
    for symbol, each in limits.responses.items():
        yield symbol, each.low if each.high is None else each.high, each.unit, "limit"


@dataclass(frozen=True, slots=True)
class DrawnLaw:
    """A law as its figures and their texts show it.

    Attributes
    ----------
    law : LawSection
    middle : dict of float
        Middle of each factor.
    level : str or None
        The level of a category.
    over : tuple of str
        The first two factors over which it is drawn: tested at more than one value, and no wear of its own law.
    own : LawSection or None
        The law of the wear among the factors, where the wear can follow from it.
    own_middle : dict of float
        Middle of the factors of ``own``.
    wear : tuple of str, or None
        How the wear is set, in words: from its own law, and held at its middle.
    limit : tuple of float and str, or None
        Limit of the response, and its words.
    """

    law: LawSection
    middle: dict[str, float]
    level: str | None
    over: tuple[str, ...]
    own: LawSection | None
    own_middle: dict[str, float]
    wear: tuple[str, str] | None
    limit: tuple[float, str] | None

    def at_first(self, values: Any, *, held: bool = False) -> dict[str, Any]:  # noqa: ANN401
        """Conditions at values of the first factor, a number or an array, the others at their middle.

        A wear follows from its own law at these conditions, unless it is ``held``.
        """
        at = {**self.middle, self.law.factors[0].symbol: values}
        return at if held else self.with_own_wear(at)

    def with_own_wear(self, at: Mapping[str, Any]) -> dict[str, Any]:
        """Conditions with the wear of its own law in place of the one given."""
        if self.own is None:
            return dict(at)
        here = {name: at.get(name, value) for name, value in self.own_middle.items()}
        return {**at, self.own.response: self.own.values(here, by=reference(self.own))}


def drawn_laws(pf: ParameterFile) -> tuple[DrawnLaw, ...]:
    """The laws of a file that are drawn: those with factors."""
    limits = limits_of(pf)
    return tuple(_drawn_law(pf, law, limits.get(law.response)) for law in pf.laws.values() if law.factors)


def _drawn_law(pf: ParameterFile, law: LawSection, limit: tuple[float, str] | None) -> DrawnLaw:
    wear, at = substituted_wear(law, pf), middle(law)
    over = tuple(f.symbol for f in law.factors if f.symbol != wear and f.high > f.low)[:2]
    if not wear or wear == law.factors[0].symbol:
        return DrawnLaw(law, at, reference(law), over, None, {}, None, limit)
    own, unit = pf.laws[wear], next(f.unit for f in law.factors if f.symbol == wear)
    words = OWN.format(wear), HELD.format(wear, quantity(figure(at[wear], 3, unit)))
    return DrawnLaw(law, at, reference(law), over, own, middle(own), words, limit)


def response_text(of: DrawnLaw, part: ProfiledLawPart) -> str:
    """A law at both ends of its first factor, in a sentence; of a law on wear, also with the wear held."""
    law, wear = of.law, of.wear
    others = {
        name: value
        for name, value in of.middle.items()
        if name != law.factors[0].symbol and not (wear and name in FLANK_WEAR)
    }
    at = at_words(law, others, of.level)
    words = ", ".join(filter(None, (at, wear[0] if wear else "")))
    text = f"{law.response} {_ends(of, part)}{f', with {words}' if words else ''}"
    return f"{text}; with {wear[1]} it {_ends(of, part, held=True)}." if wear else f"{text}."


def _ends(of: DrawnLaw, part: ProfiledLawPart, *, held: bool = False) -> str:
    """Turn and values of a law between both ends of its first factor."""
    first = of.law.factors[0]
    low, high = (profile(part, of.at_first(end, held=held)) for end in (first.low, first.high))
    ends = [
        f"{_value(part, found)} at {first.symbol} {quantity(figure(end, 4, first.unit))}"
        for found, end in ((low, first.low), (high, first.high))
    ]
    return f"{'increases' if high[0] > low[0] else 'decreases'} from {ends[0]} to {ends[1]}"


def _drawn(pf: ParameterFile, parts: Sequence[LawPart]) -> Iterator[FigurePart]:
    """Those drawn from the parameter file alone."""
    tables = {law.response: _exponents(law) for law in parts if law.form == "power"}
    if any(tables.values()):
        yield FigurePart(name="exponents", caption=EXPONENTS, alternative=_of_exponents(tables))
    laws = [(of, profiled(of.law, pf)) for of in drawn_laws(pf)]
    if laws:
        yield FigurePart(
            name="responses",
            caption=RESPONSES.format(_wear_caption([of for of, _ in laws]), band_of(pf)),
            alternative=" ".join(response_text(of, part) for of, part in laws),
        )
    if any(len(of.over) == 2 for of, _ in laws):
        text = " ".join(surface_text(of, part) for of, part in laws if len(of.over) == 2)
        yield FigurePart(name="surfaces", caption=SURFACES, alternative=text)
    if pf.dynamics is not None:
        yield FigurePart(name="dynamics", caption=DYNAMICS, alternative=_of_dynamics(pf.dynamics))
    if pf.dynamics is not None and pf.pi is not None and pf.pi.figures is not None and pf.pi.figures.stable:
        yield FigurePart(name="loop", caption=LOOP, alternative=_of_loop(pf.pi))


def _wear_caption(laws: Sequence[DrawnLaw]) -> str:
    """Caption of the curves, where a law is on a wear that has its own law."""
    found = next((of.own.response for of in laws if of.own is not None), "")
    return f" ({OWN.format(found)}; dashed: {found} held)" if found else ""


def surface_text(of: DrawnLaw, part: ProfiledLawPart) -> str:
    """A law at the middle of the tests and the limit of its response, in a sentence."""
    bound = f"; the {of.limit[1]} is drawn dashed where it is reached" if of.limit else ""
    value = _value(part, profile(part, of.with_own_wear(of.middle)))
    words = at_words(of.law, of.middle, of.level)
    return f"Contours of {of.law.response} over {of.over[0]} and {of.over[1]}: {value} at {words}{bound}."


def _pictures(pf: ParameterFile, folder: Path | None) -> Iterator[FigurePart]:
    """Pictures in ``figures`` of the folder of the card."""
    place = None if folder is None else folder / FOLDER
    names = sorted(path.name for path in place.glob("*.png")) if place is not None and place.is_dir() else []
    for name in names:
        stem = name.removesuffix(".png")
        yield FigurePart(name=stem, caption=_caption(stem), alternative=_of_picture(pf, stem), file=f"{FOLDER}/{name}")


def _exponents(law: LawPart) -> list[CoefficientPart]:
    names = {f.symbol for f in law.domain}
    return [c for c in law.coefficients if c.name in names and c.low.text]


def _of_exponents(tables: dict[str, list[CoefficientPart]]) -> str:
    parts = [
        f"{name}: " + ", ".join(f"{c.name} {c.estimate.text} ({c.low.text} to {c.high.text})" for c in lines)
        for name, lines in tables.items()
        if lines
    ]
    return f"Exponents as points with bars. {'; '.join(parts)}."


def _value(law: ProfiledLawPart, found: Value) -> str:
    value, low, high = found
    band = "" if low is None else f" ({figure(low, 3).text} to {figure(high, 3).text})"
    return f"{quantity(figure(value, 3, law.unit))}{band}"


def _of_dynamics(d: DynamicsSection) -> str:
    unit = f"{d.unit_y or 'output'}/{d.unit_u or 'input'}"
    rest = f"{figure(d.dc_gain).text} {unit}" if math.isfinite(d.dc_gain) else INFINITE.text
    ends = d.band or (0.05 / d.sample_time, 0.25 / d.sample_time)
    at = [
        f"{figure(abs(g), 3).text} {unit} and a phase of {math.degrees(math.atan2(g.imag, g.real)):.0f}° at {f:.3g} Hz"
        for f, g in ((f, complex(d.response(f))) for f in ends if f > 0)
    ]
    excited = "; the input was excited between these frequencies" if d.band else ""
    return f"Bode diagram: static gain {rest}, {', '.join(at)}{excited}."


def _of_loop(pi: PiSection) -> str:
    f = pi.figures
    parts = ["Response to a unit step"]
    if f is not None and f.rise_time is not None:
        parts.append(f"rises from 10 to 90 % in {figure(f.rise_time, 3).text} s")
    if f is not None and f.overshoot is not None:
        parts.append(f"overshoots by {percent(f.overshoot).text} %")
    if f is not None and f.settling_time is not None:
        parts.append(f"stays within 2 % after {figure(f.settling_time, 3).text} s")
    return ", ".join(parts) + "."


def _scale(law: LawSection) -> str:
    return "in ln" if law.residual_scale == "ln" else law.residual_scale


def _caption(stem: str) -> str:
    if stem in PICTURES:
        return PICTURES[stem]
    if stem.startswith("posterior_"):
        response, _, what = stem.removeprefix("posterior_").rpartition("_")
        return f"Posterior of {response}: {what}"
    return stem.replace("_", " ")


def _of_picture(pf: ParameterFile, stem: str) -> str:
    """Text alternative of a picture, with its numbers in the parameter file."""
    laws = pf.laws.values()
    if stem == "observed_predicted" and pf.laws:
        fits = [f"{law.response} R² {law.statistics.r2:.4f}" for law in laws if law.statistics.r2 is not None]
        return f"Points about the diagonal, {', '.join(fits) or 'a panel a law'}."
    if stem == "residuals" and pf.laws:
        spread = [f"{law.response} {figure(law.residual_se, 3).text} {_scale(law)}" for law in laws
                  if law.residual_se is not None]  # fmt: skip
        return f"Residuals scatter about zero; their standard error: {', '.join(spread) or 'not known'}."
    if stem == "response_surfaces" and pf.laws:
        drawn = {of.law.response: of for of in drawn_laws(pf)}
        return " ".join(
            response_text(drawn[law.response], profiled(law, pf)) if law.factors else law.equation for law in laws
        )
    if stem == "pi" and pf.pi is not None and pf.pi.figures is not None:
        return _of_loop(pf.pi)
    if stem == "bode" and pf.dynamics is not None:
        return _of_dynamics(pf.dynamics)
    if stem == "simulated" and pf.dynamics is not None and pf.dynamics.held_out_fit is not None:
        return (
            f"A simulation explains {pf.dynamics.held_out_fit:.1f} % of the variation of samples not used in the fit."
        )
    if stem == "drive" and pf.drive is not None and pf.drive.simulated_fit is not None:
        return f"The simulation explains {pf.drive.simulated_fit:.1f} % of the measured speed."
    if stem == "step_response" and pf.dynamics is not None and pf.dynamics.notes:
        return pf.dynamics.notes[0]
    if stem == "force_process" and pf.adaptive_force is not None and pf.adaptive_force.notes:
        return pf.adaptive_force.notes[0]
    return f"{_caption(stem)}; its numbers are not in the parameter file."
