"""MATLAB v5: one struct, ``fitmodels``, that MATLAB, Octave and scipy load.

    fitmodels.about       tool, work, machine, checksum of the parameter file, what was assumed
    fitmodels.quantities  every number by its name;  fitmodels.units, fitmodels.words  the same names, as text
    fitmodels.plant       num, den, nk, Ts, unit_u, unit_y of the identified feed drive
    fitmodels.pi          Kp, Ki as tuned; C_num, C_den (error to command), H_num, H_den (load to what is compared)

A num and its den have one length, so that they are one system whether read in falling powers of z or in z^-1:
``tf(num, den, Ts)``, ``filt(num, den, Ts)`` and ``filter(num, den, u)`` agree.
"""

from collections.abc import Sequence
from dataclasses import asdict
from io import BytesIO
from typing import Any

import numpy as np

from ...core.arrays import Array
from .view import ExportView, PlantModel, TunedGains

HEAD = 116  # bytes of free text at the start of a v5 file: scipy writes the time there, and no two files are alike

NOT_IN_MAT = (
    "the covariance, the posterior and the domain of the laws: the struct holds values and units",
    "tf or pid objects, which differ from program to program: build them from num, den and Ts",
    "pid(Kp, Ki, 0, 0, Ts) of Octave's control 3.4, which substitutes z for s: use tf(C_num, C_den, Ts)",
    "limits and engagement as a block: they are among the quantities",
)


def mat_file(view: ExportView) -> bytes:
    """Content of the .mat file; the same view gives the same bytes."""
    from scipy.io import savemat

    file = BytesIO()
    savemat(file, {"fitmodels": _struct(view)}, format="5", long_field_names=True, oned_as="row")  # type: ignore[arg-type]  # stubs know names of files alone
    head = f"MATLAB 5.0 MAT-file, {view.made_by}, parameter file {view.checksum[:16]}"
    return head.encode("ascii")[:HEAD].ljust(HEAD) + file.getvalue()[HEAD:]


def _struct(view: ExportView) -> dict[str, Any]:
    """The sections; one that the file lacks is left out, as an empty struct would fail later."""
    return {
        "about": _about(view),
        **({"quantities": {q.name: q.value for q in view.quantities}} if view.quantities else {}),
        **({"units": {q.name: q.unit for q in view.quantities}} if view.quantities else {}),
        **({"words": {q.name: q.words for q in view.quantities}} if view.quantities else {}),
        **({} if view.plant is None else {"plant": _plant(view.plant)}),
        **({} if view.gains is None else {"pi": _pi(view.gains)}),
    }


def _about(view: ExportView) -> dict[str, Any]:
    return {
        "made_by": view.made_by, "parameter_file": view.checksum,
        "tool": view.tool, "work": view.work, "machine": view.machine,
        "simulated": np.nan if view.simulated is None else view.simulated,
        "verdicts": " ".join(view.verdicts) or "usable inside the tested region",
        "limits_of_use": "; ".join(view.limits_of_use),
        "assumed": "; ".join(view.assumed) or "nothing", "not_carried": "; ".join(NOT_IN_MAT),
    }  # fmt: skip


def _plant(plant: PlantModel) -> dict[str, Any]:
    num, den = _level(plant.b, plant.a)
    return {
        "num": num, "den": den, "nk": float(plant.nk), "Ts": plant.sample_time, "unit_Ts": "s",
        "unit_u": plant.unit_u, "unit_y": plant.unit_y, "unit_num": f"({plant.unit_y})/({plant.unit_u})",
        "unit_den": "1",
    }  # fmt: skip


def _pi(gains: TunedGains) -> dict[str, Any]:
    from ...ident.pi.gains import PiGains

    pi = PiGains(**asdict(gains))
    (C_num, C_den), (H_num, H_den) = _level(*pi.forward), _level(*pi.feedback)
    per = f"({gains.unit_u})/({gains.unit_y})"
    limits = {"low": gains.low, "high": gains.high, "rate": gains.rate, "tracking_time": gains.tracking_time}
    return {
        "Kp": gains.kp, "Ki": gains.ki, "Ts": gains.sample_time, "form": gains.form, "integration": gains.integration,
        "delay": float(gains.delay), "filter_time": gains.filter_time, "average": float(gains.average),
        "average_of": gains.average_of, "setpoint_weight": gains.setpoint_weight, "anti_windup": gains.anti_windup,
        **{name: value for name, value in limits.items() if value is not None},
        "C_num": C_num, "C_den": C_den, "H_num": H_num, "H_den": H_den,
        "unit_Kp": per, "unit_Ki": f"{per}/s", "unit_Ts": "s", "unit_delay": "samples", "unit_filter_time": "s",
        "unit_average": "samples", "unit_low": gains.unit_u, "unit_high": gains.unit_u,
        "unit_rate": f"({gains.unit_u})/s", "unit_tracking_time": "s", "unit_setpoint_weight": "1",
        "unit_C_num": per, "unit_C_den": "1", "unit_H_num": "1", "unit_H_den": "1",
    }  # fmt: skip


def _level(num: Sequence[float] | Array, den: Sequence[float] | Array) -> tuple[Array, Array]:
    """Both polynomials in z^-1 at one length, with zeros behind."""
    length = max(len(num), len(den))
    above, below = (np.pad(np.asarray(p, dtype=np.float64), (0, length - len(p))) for p in (num, den))
    return above, below
