"""Reference force of a roughness: SURF's eq. 4, which is missing in the copy used, in two readings.

    inverse       F_ref = ln(Ra_ref / a) / b, of the law Ra = a exp(b F) (eq. 5)
    regression    F_ref = constant + slope ln Ra_ref, fitted to forces and desired roughness (Table 1: 450 + 260 ln Ra)

Both are reconstructions. They differ by 30 N at Ra 1.0 um: the table prints 448 N, the inverse gives 420 N.
"""

import math
from typing import TYPE_CHECKING, Literal

from ...core.errors import ParameterError, UsageError

if TYPE_CHECKING:
    from ...parameters import LawSection, ParameterFile
    from ...parameters.sections.force_control import RoughnessSection

Reading = Literal["inverse", "regression"]


def settings_of(pf: "ParameterFile") -> "RoughnessSection":
    """The roughness section of a file.

    Raises
    ------
    ParameterError
        There is none, or it or its law is in other units than um, N and mm/rev.
    """
    section = pf.roughness
    if section is None:
        raise ParameterError("The file has no roughness section; add it with collect(roughness=...).")
    law = law_of(pf)
    units = section.unit_roughness, section.unit_force, section.unit_feed, law.unit, law.factors[0].unit
    if units != ("um", "N", "mm/rev", "um", "N"):
        message = f"The roughness section is in {', '.join(units[:3])} and its law in {units[3]} and {units[4]}"
        raise ParameterError(f"{message}; write them in um, N and mm/rev.")
    return section


def law_of(pf: "ParameterFile") -> "LawSection":
    """The law Ra = a exp(b F) of a file with a roughness section.

    Raises
    ------
    ParameterError
        It is missing, of another form, by levels, or falls with force.
    """
    name = "Ra" if pf.roughness is None else pf.roughness.law
    law = pf.laws.get(name)
    if law is None:
        raise ParameterError(f"The file has no law of {name[:40]!r}; fit one to roughness and force.")
    if law.form != "exponential" or law.by is not None or not law.coefficients["b"] > 0:
        form = "Ra = a exp(b F) of one level that rises with force"
        raise ParameterError(f"The law of {name[:40]} is not {form}; fit such a law.")
    return law


def reference_force(pf: "ParameterFile", roughness: float | None = None, force_from: Reading | None = None) -> float:
    """Force that gives a roughness.

    Parameters
    ----------
    pf : ParameterFile
        With a roughness section and its law.
    roughness : float, optional
        um; by default the roughness required by the file.
    force_from : {"inverse", "regression"}, optional
        By default the file's reading.

    Returns
    -------
    float
        N. Of the file's own roughness and reading: as it is written there.

    Raises
    ------
    UsageError
        The roughness has no force above the threshold, or no regression stands in the file.
    ParameterError
        The file lacks the section or its law.

    Examples
    --------
    >>> from fitmodels.parameters.published import published
    >>> [round(reference_force(published("SURF"), 1.0, reading)) for reading in ("inverse", "regression")]
    [420, 450]
    """
    section = settings_of(pf)
    Ra = section.roughness if roughness is None else roughness
    reading = section.force_from if force_from is None else force_from
    if (Ra, reading) == (section.roughness, section.force_from):
        return section.force
    if not Ra > 0:
        raise UsageError(f"roughness {Ra!r} um: give a value above zero.")
    if reading == "inverse":
        law = law_of(pf).coefficients
        F = math.log(Ra / law["a"]) / law["b"]
    elif section.regression is not None:
        F = section.regression.constant + section.regression.slope * math.log(Ra)
    else:
        raise UsageError(
            f"roughness {Ra:g} um: the file holds no regression of force on roughness, only the force of "
            f"{section.roughness:g} um; add it as roughness.regression, or use the inverse of the law."
        )
    if not section.threshold < F < math.inf:
        raise UsageError(
            f"roughness {Ra:g} um needs a force of {F:.4g} N, not above the threshold of the control, "
            f"{section.threshold:g} N; choose a rougher surface, or lower the threshold."
        )
    return F
