"""The step of a reading that adds computed quantities, and says what stands for those that do not follow."""

import numpy as np

from ..core.errors import UsageError
from .columns import NONE, Values
from .cut_length import summed
from .derived import Known, apply, known_of
from .derived_checks import compare
from .doubts import Doubt
from .draft import Draft
from .options import ReadOptions
from .vocabulary import ROLES


def derive(draft: Draft, options: ReadOptions) -> None:
    """Add the quantities that the columns of a draft allow, and compare those that are both measured and computed."""
    known = known_of(draft.data, draft.notes, options)
    _no_constant_twice(draft, options, known)
    compare(draft, known)
    words = {use.role: f"{use.name!r}" for use in draft.uses if use.role is not None}
    found = apply(known, words)
    found = [summed(draft, known, one) if one.role == "t" else one for one in found]
    draft.units.update({one.role: ROLES[one.role].unit for one in found if one.role in draft.data})
    draft.derived += found
    draft.assumed[:0] = [one.sentence for one in found]
    _substitutes(draft, known)
    used = {role for one in found for role in one.inputs}
    draft.warnings += [
        f"{given} is not used: no quantity that is not measured follows from it"
        for role, given in known.given.items()
        if given.source == "--value" and role not in used
    ]


def _no_constant_twice(draft: Draft, options: ReadOptions, known: Known) -> None:
    for role, value in options.constants.items():
        if role in draft.data:
            header = next((use.header for use in draft.uses if use.role == role), role)
            raise UsageError(
                f"--value {role}={value:g}: column {header!r} holds {role} already; leave one of the two out "
                f"(--map {role}={NONE} leaves the column out)."
            )


def _substitutes(draft: Draft, known: Known) -> None:
    """Say which quantity stands for the feed or the speed of the laws where f or V is not known."""
    data = draft.data
    if "f" not in data and "fz" in data:
        draft.assumed.append(
            "the feed of the laws is fz, feed per tooth: its exponent is that of f where the number of teeth "
            "is constant; --value z=4 (the number of teeth) gives f"
        )
    elif "f" not in data and "fm" in data and len(data.keys() & {"V", "n", "d", "t"}):
        draft.assumed.append("the feed of the laws is fm, feed rate: neither spindle speed nor diameter is known")
        if "V" in data and _varies(data["V"]) and _varies(data["fm"]):
            draft.doubts.append(
                Doubt(
                    ("V", "fm"),
                    "the feed is known as a feed rate alone and V varies: the exponent of V holds at constant feed "
                    "rate, not at constant feed per revolution; the diameter (--value D=..., in mm) gives f",
                )
            )
    if "V" not in data and "n" in data and "V" not in known.unwanted and _varies(data["n"]):
        draft.assumed.append(
            "the speed of the laws is n, spindle speed: the diameter is not known; --value D=80 (the diameter in mm) "
            "gives V"
        )
    if not {"t", "T"} & data.keys() and "t" not in known.unwanted and {"lf", "lc"} & data.keys():
        draft.assumed.append(
            "the time in cut does not follow from the cut length: neither feed rate nor diameter is known; "
            "--value D=80 (the diameter in mm) gives t"
        )


def _varies(values: Values) -> bool:
    known = np.asarray(values, dtype=float)
    return bool(np.nanmin(known, initial=np.inf) < np.nanmax(known, initial=-np.inf))
