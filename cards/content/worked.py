"""Worked predictions of a card: each law at the middle of its tests, with the command that computes it."""

import math
import shlex
from collections.abc import Mapping
from typing import TYPE_CHECKING

from ...core.errors import FitmodelsError, ParameterError
from ...parameters import LawSection, ParameterFile
from ...parameters.evaluation import IntervalOptions
from ...parameters.prediction import predict_with_interval
from .design import at_words, middle, reference
from .numbers import figure, number, percent, quantity
from .parts import FactPart, WorkedPart
from .profiler import ON_NEW_EDGE, ROW, substituted_wear

if TYPE_CHECKING:
    from ...core.predictions import Prediction

FILE = "params.json"  # in the commands of a card
LIFE = "one new life"


def worked_predictions(pf: ParameterFile, law: LawSection) -> tuple[WorkedPart, ...]:
    """A prediction for one new observation at the middle of the tests; none where the law has no interval there.

    A law on a wear has two: with the wear from its own law at these conditions, as ``fitmodels predict`` takes it,
    then with the wear held at the middle of its range.

    Parameters
    ----------
    pf : ParameterFile
    law : LawSection
        One of its laws.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> from fitmodels.parameters.sections.law import EXAMPLE
    >>> pf = parameters.collect(tool="GC435", work="709M40")
    >>> [one.command for one in worked_predictions(pf, LawSection.model_validate(EXAMPLE))]
    ['fitmodels predict params.json AW V=100']
    """
    own = substituted_wear(law, pf)
    at, by = dict(middle(law)), reference(law)
    try:
        held = law.predict(at, by=by)
        found = [(held, at)]
        if own:
            free = middle(pf.laws[own]) | {name: value for name, value in at.items() if name != own}
            found.insert(0, (_with_own_wear(pf, law, own, free), free))
    except ParameterError:
        return ()
    return tuple(_part(law, one, where, own) for one, where in found)


def _with_own_wear(pf: ParameterFile, law: LawSection, own: str, at: Mapping[str, float]) -> "Prediction":
    """The prediction with the wear of another law at the same conditions."""
    wear = pf.laws[own]
    asked = IntervalOptions("prediction")
    source = predict_with_interval(wear, asked, reference(wear), {f.symbol: at[f.symbol] for f in wear.factors})
    given = {f.symbol: at[f.symbol] for f in law.factors if f.symbol != own}
    return predict_with_interval(law, asked, reference(law), given, {own: source})


def _part(law: LawSection, found: "Prediction", at: Mapping[str, float], own: str) -> WorkedPart:
    by = reference(law)
    value, low, high = (float(x) for x in (found.value, found.low, found.high))
    width = min((high - low) / 2, low) if low > 0 else (high - low) / 2
    here = {g.symbol: float(g.value) for g in found.given}
    return WorkedPart(
        at=at_words(law, {name: x for name, x in here.items() if name != own}, by),
        wear=wear_words(law, own, here[own], held=own in at) if own else "",
        value=number(value, width, law.unit),
        low=number(low, width, law.unit),
        high=number(high, width, law.unit),
        level=percent(found.level),
        of={"new": ON_NEW_EDGE, "independent rows": ROW}.get(found.edge, found.edge) if law.life is None else LIFE,
        inside=bool(found.inside),
        words=found.words,
        command=predict_command(law.response, at, by),
    )


def wear_words(law: LawSection, wear: str, value: float, *, held: bool) -> str:
    """``AW 0.152 mm from its own law``, or ``AW held at 0.158 mm``."""
    at = quantity(figure(value, 3, next(f.unit for f in law.factors if f.symbol == wear)))
    return f"{wear} held at {at}" if held else f"{wear} {at} from its own law"


def predict_command(response: str, at: Mapping[str, float], by: str | None = None) -> str:
    """The command that predicts a response at a setting, from the folder of the parameter file.

    >>> predict_command("AW", {"V": 100.0, "f": 0.1897})
    'fitmodels predict params.json AW V=100 f=0.1897'
    """
    words = [response, *(f"{name}={value:.6g}" for name, value in at.items()), *(["--by", by] if by else [])]
    return shlex.join(["fitmodels", "predict", FILE, *words])


def scatter(law: LawSection) -> FactPart | None:
    """Standard deviation of one row about the law: in per cent for multiplicative errors; None where it is not known.

    >>> from fitmodels.parameters.sections.law import EXAMPLE
    >>> scatter(LawSection.model_validate(EXAMPLE)).number.text
    '11'
    """
    se = law.residual_se
    if se is None:
        return None
    relative = law.error == "multiplicative"
    of = "one row" if law.life is None else "one life"
    spread = figure(100 * math.expm1(se), 2, "%") if relative else figure(se, 2, law.unit)
    return FactPart(name="scatter", number=spread, words=f"standard deviation of {of} about the law")


def scatter_words(law: LawSection) -> str:
    """The scatter of one row, or of one life, in words; empty where it is not known.

    Of additive errors it is in the unit where the response at the middle of the tests is not known, else in per cent.

    >>> from fitmodels.parameters.sections.law import EXAMPLE
    >>> scatter_words(LawSection.model_validate(EXAMPLE))
    'scatter of one row 11 %'
    """
    found = scatter(law)
    if found is None or law.residual_se is None:
        return ""
    try:
        at_middle = float(law.predict(middle(law), by=reference(law)).value)
    except FitmodelsError:
        at_middle = 0.0
    relative = law.error == "multiplicative" or not at_middle
    spread = found.number if relative else figure(100 * law.residual_se / abs(at_middle), 2, "%")
    return f"scatter of {'one row' if law.life is None else 'one life'} {quantity(spread)}"


def short_equation(law: LawSection) -> str:
    """The equation with each number rounded by its standard error, to read; `LawSection.equation` is to compute with.

    >>> from fitmodels.parameters.sections.law import EXAMPLE
    >>> short_equation(LawSection.model_validate(EXAMPLE))
    'AW = 0.01 V^0.5'
    """
    if not all(name.isidentifier() for name in (law.response, *law.formula.factors)):
        return law.equation
    texts = [_rounded(law.coefficients[name], law.standard_errors.get(name)) for name in law.formula.names]
    level = "" if law.by is None else f" for {law.by.column} {law.by.reference}"
    return f"{law.response} = {law.formula.equation(texts)}{level}"


def _rounded(value: float, se: float | None) -> str:
    """To the decimals of the standard error, as in the table; to one digit where these would leave a zero.

    >>> _rounded(0.00434, 0.0381), _rounded(0.00034, 0.0381)
    ('0.004', '0.0003')
    """
    text = number(value, se).text
    return text if any(digit in text.partition("e")[0] for digit in "123456789") else figure(value, 1).text
