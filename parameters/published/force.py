"""End milling SKD41 under adaptive force control: set points and spindle speed of LYAP, and what it does not print.

The paper (adaptive cutting force control for CNC milling machines by Lyapunov's method; the copy used names no authors
and no journal) prints eq. 2.1-10, three depths with their target forces, the tool, the spindle speed and the work. It
prints no value of m, d, k, c, of a gain, or of a limit. Estimates, dynamics and PI gains here are what fitmodels
identified and tuned on a **simulated** run of an **assumed** plant: drive 0.08 s, process 1/c = 0.02 s, 0.4 N per
mm/min for each mm of depth.
"""

from collections.abc import Mapping

from ...core.verdict import DO_NOT_USE
from ...core.version import __version__
from ..file import ParameterFile, sealed
from . import unchecked

SET_POINTS: Mapping[float, float] = {1.0: 150.0, 2.0: 200.0, 4.0: 320.0}  # mm -> N, section 4
SPINDLE_SPEED = 3000.0  # 1/min, section 4
DIAMETER = 10.0  # mm, section 4
REVOLUTION = 60.0 / SPINDLE_SPEED  # s

SEED = 1  # of the simulated run
SAMPLE_TIME, SAMPLES, DEPTH = 0.004, 5000, 2.0  # s, and mm, of that run

# m/k, (mc + d)/k, dc/k from the run: s^2, s and 1 times mm/min per N
ESTIMATES = (1.996125460872601e-3, 0.12495598948630941, 1.2502111605128687)
COVARIANCE = (
    (6.758453185e-11, 1.093455385e-11, 9.853373225e-11),
    (1.093455385e-11, 1.776940730e-08, -8.543212335e-10),
    (9.853373225e-11, -8.543212335e-10, 3.177829409e-08),
)
B = (0.0, 0.0027410712419081705, 0.004587253547174287)
A = (1.0, -1.762518760175892, 0.7716808107114774)
MODEL_COVARIANCE = (  # of a1, a2, b1, b2
    (1.3143316534281936e-05, -1.2585908652701202e-05, -1.6446690465768388e-06, 2.0904466034708047e-06),
    (-1.2585908652701202e-05, 1.20522527712601e-05, 1.574238259503995e-06, -2.001022383956544e-06),
    (-1.6446690465768388e-06, 1.574238259503995e-06, 2.2115235745527395e-07, -2.774684168922918e-07),
    (2.0904466034708047e-06, -2.001022383956544e-06, -2.774684168922918e-07, 3.4897370331840595e-07),
)
NOISE_VARIANCE = 1896.1361  # N^2: the ripple of the teeth, most of it
KP, KI = 2.284242541968487, 20.837452457768013  # mm/min per N, and that per second

LOW, HIGH = 30.0, 600.0  # mm/min: 0.005 and 0.1 mm a tooth with two flutes
OF_SIMULATION = unchecked(
    "the paper prints no values",
    "Estimates are from a simulated run of an assumed plant: they are those of no machine.",
    level=DO_NOT_USE,
)
SIMULATED = "From a simulated run (chirp of the feed, 20 s, 2 mm deep, 30 % ripple at 100 Hz, 2 N of noise, seed 1)."


def lyap() -> ParameterFile:
    """LYAP: set points as printed; estimates, dynamics and PI gains from a simulated run; the rest assumed.

    Examples
    --------
    >>> pf = lyap()
    >>> [point.force for point in pf.adaptive_force.set_points], round(pf.adaptive_force.beta, 3)
    ([150.0, 200.0, 320.0], 1.25)
    """
    sections: dict[str, object] = {
        "identity": {
            "tool": "10 mm flat end mill", "work": "SKD41", "machine": "Makino",
            "setup": "milling at 3000 1/min, force by dynamometer under the work", "iso13399": {"DC": DIAMETER},
            "simulated": True,
            "note": "The paper prints set points, tool, speed and work; all else is from a simulated run or assumed.",
        },
        "dynamics": _dynamics(), "pi": _pi(),
        "limits": {"spindle_speed": {"low": SPINDLE_SPEED, "high": SPINDLE_SPEED, "unit": "1/min"}},
        "adaptive_force": _adaptive_force(),
        "provenance": {"fitmodels": __version__, "options": {"paper": "LYAP", "source": "eq. 2.1-10"}, "seed": SEED},
    }  # fmt: skip
    return sealed(ParameterFile.model_validate(sections))


def _adaptive_force() -> dict[str, object]:
    time = 0.15
    rate = 2e-5
    return {
        **dict(zip(("m", "alpha", "beta"), ESTIMATES, strict=True)),
        "uncertainty": {"kind": "covariance", "of": ("m", "alpha", "beta"), "matrix": COVARIANCE, "df": SAMPLES - 4},
        "g1": rate * time**4, "g2": rate * time**2, "g3": rate, "Kd": 0.05, "lam": 30.0,
        "set_points": [{"depth": depth, "force": force} for depth, force in SET_POINTS.items()], "unit_u": "mm/min",
        "unit_force": "N", "unit_depth": "mm", "reference_time": time, "reference_damping": 1.0, "sample_time": 0.001,
        "average_time": REVOLUTION, "low": LOW, "high": HIGH, "depth": DEPTH, "force_low": -20.0, "force_high": 1500.0,
        "verdict": OF_SIMULATION,
        "notes": [
            "Set points, depths and the spindle speed behind average_time: as printed; the paper gives the forces in "
            "Nm, a misprint for N.",
            f"m, alpha, beta over k: {SIMULATED} Assumed plant: m 0.08 s, d 1, c 50 1/s, k 40 N/s per mm/min at 2 mm.",
            "Assumption: the command is the feed in mm/min and the drive reaches the feed commanded, so d is 1.",
            "Assumption: k grows with the depth, c does not: twice the depth halves what the estimates look for.",
            "Assumption: Kd, lambda, rates, reference model, limits of command and reading, sample time. Rates g2 and "
            "g1 are g3 times reference_time squared and to the fourth, the sizes of F_d' and F_d'' against F_d.",
        ],
    }  # fmt: skip


def _dynamics() -> dict[str, object]:
    names = ("a1", "a2", "b1", "b2")
    return {
        "structure": "output_error", "b": B, "a": A, "nk": 1, "sample_time": SAMPLE_TIME, "input": "feed command",
        "output": "F", "unit_u": "mm/min", "unit_y": "N",
        "uncertainty": {"kind": "covariance", "of": names, "matrix": MODEL_COVARIANCE, "df": SAMPLES - 4},
        "verdict": OF_SIMULATION, "noise_variance": NOISE_VARIANCE, "n": SAMPLES, "operating_point": (0.0, 0.0),
        "band": (0.1, 5.0),
        "notes": [SIMULATED, "The noise is coloured by the teeth; the standard errors allow for it."],
    }  # fmt: skip


def _pi() -> dict[str, object]:
    return {
        "kp": KP,
        "ki": KI,
        "sample_time": SAMPLE_TIME,
        "average": round(REVOLUTION / SAMPLE_TIME),
        "low": LOW,
        "high": HIGH,
        "unit_u": "mm/min",
        "unit_y": "N",
        "specification": {"overshoot": 0.02, "ms": 1.6, "integral_time": 3.220021007329822, "steady_error": 1e-6},
        "figures": {
            "stable": True, "rise_time": 0.06014, "settling_time": 0.2833, "overshoot": 0.02, "undershoot": 0.0,
            "steady_error": 0.0, "ms": 1.4784, "mt": 1.0, "phase_margin": 64.757, "gain_margin": 5.1535,
            "delay_margin": 0.05662,
        },
        "method": "smallest iae",
        "notes": [
            "Not the paper's: tuned by fitmodels on the dynamics of this file, to hold the adaptive law against.",
            "Sensitivity peak Ms at most 1.6, integral time at most 3.22 s and overshoot at most 2 %: assumed.",
        ],
    }  # fmt: skip
