"""The record of the dynamics against the load tests: whether both were made in the same range of load."""

from typing import Final

from ...core.verdict import DO_NOT_USE
from ..file import ParameterFile
from ..messages import in_unit, short
from ..setting_words import loads_tested

MARGIN: Final = 0.25  # of the range of loads tested: a mean of the record may lie this far outside


def record_notes(pf: ParameterFile, ends: tuple[float, float] | None = None) -> list[str]:
    """A sentence where the operating point of the record lies outside the loads tested of a load law.

    Parameters
    ----------
    pf : ParameterFile
    ends : tuple of float, optional
        Smallest and largest output of the record, in the unit of the dynamics; a file does not hold them.
    """
    from ...datasets.records.reading import DEVIATIONS  # loads readers of files

    model = pf.dynamics
    if model is None or model.operating_point is None or model.integrating or any(map(DEVIATIONS.search, model.notes)):
        return []
    for law in pf.laws.values():
        if law.form != "load_line" or (law.verdict is not None and law.verdict.concern == DO_NOT_USE):
            continue
        point = in_unit(model.operating_point[1], model.unit_y, law.unit)
        low, high = loads_tested(law)
        slack = MARGIN * (high - low)
        if point is None or low - slack <= point <= high + slack:
            continue
        scaled = [] if ends is None else [in_unit(end, model.unit_y, law.unit) for end in ends]
        over = " to ".join(f"{end:.2g}" for end in scaled if end is not None)
        about = f"{point:.2g} {law.unit}" + (f" ({over} {law.unit})" if over else "")
        return [
            f"The record of the dynamics was made about {about}, the tests of {short(law.response)} lie at {low:.2g} "
            f"to {high:.2g} {law.unit} by their law: if the record holds deviations from a cutting load, state it with "
            "--deviations; otherwise it was not made in a cut."
        ]
    return []
