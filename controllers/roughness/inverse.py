"""Force that gives a roughness by the inverse of the law Ra = a exp(b F), with Fieller's interval."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...core.errors import UsageError

if TYPE_CHECKING:
    from ...parameters import LawSection


@dataclass(frozen=True, slots=True)
class ForceOfRoughness:
    """Force that gives a roughness by the inverse of the law, with its confidence interval.

    Attributes
    ----------
    value : float
        N.
    low, high : float or None
        Fieller's interval, N; None where it is not known, with the ``reason``. An end may be infinite.
    level : float
    reason : str
    """

    value: float
    low: float | None
    high: float | None
    level: float
    reason: str = ""

    @property
    def undetermined(self) -> bool:
        """Whether the interval lacks an end, as the law may not rise with force at all, or reaches down to no force."""
        if self.low is None or self.high is None:
            return False
        return self.low <= 0.0 or not math.isfinite(self.low + self.high)

    @property
    def interval(self) -> str:
        """The interval in words, or why there is none.

        Examples
        --------
        >>> ForceOfRoughness(1100.0, -math.inf, 1232.0, 0.95).interval
        '95 % interval: at most 1232 N, no lower end: the tests do not determine the force'
        >>> ForceOfRoughness(557.9, 540.0, 575.0, 0.95).interval
        '95 % confidence interval 540 to 575 N, Fieller'
        >>> ForceOfRoughness(732.9, -31.75, 1443.0, 0.95).interval
        '95 % confidence interval -31.75 to 1443 N, Fieller, includes 0 N: the tests do not determine the force'
        """
        if self.low is None or self.high is None:
            return f"no interval: {self.reason}"
        name, open_ = f"{100 * self.level:g} % interval", "the tests do not determine the force"
        if math.isfinite(self.low + self.high):
            words = f"{100 * self.level:g} % confidence interval {self.low:.4g} to {self.high:.4g} N, Fieller"
            return f"{words}, includes 0 N: {open_}" if self.undetermined else words
        if math.isfinite(self.high):
            return f"{name}: at most {self.high:.4g} N, no lower end: {open_}"
        if math.isfinite(self.low):
            return f"{name}: at least {self.low:.4g} N, no upper end: {open_}"
        return f"{name}: neither a lower nor an upper end: {open_}"


def inverse_force(law: "LawSection", roughness: float, level: float = 0.95) -> ForceOfRoughness:
    """Inverse of Ra = a exp(b F) at a roughness, um, with Fieller's interval from the covariance of the law.

    Raises
    ------
    UsageError
        The roughness is not above the one at zero force.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> round(inverse_force(published("SURF").laws["Ra"], 1.6).value, 1)
    557.9
    """
    from scipy.stats import t

    from ...core.intervals import fieller

    a, b = law.coefficients["a"], law.coefficients["b"]
    if not roughness > a:
        raise UsageError(
            f"roughness {roughness:g} um: by {law.equation} it is {a:.4g} um at a force of 0, and no force gives less; "
            "ask for a rougher surface, or fit a law to tests of finer ones."
        )
    value, C = math.log(roughness / a) / b, law.uncertainty
    if C.kind == "none":
        return ForceOfRoughness(value, None, None, level, C.reason)
    i, j = C.of.index("ln a"), C.of.index("b")
    moments = C.matrix[i][i], C.matrix[i][j], C.matrix[j][j]
    quantile = float(t.ppf(0.5 + level / 2, C.df))
    found = fieller(math.log(a) - math.log(roughness), b, moments, quantile)
    return ForceOfRoughness(value, found.low, found.high, level)
