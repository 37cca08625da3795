"""Milling of S45C with a 2 mm carbide end mill at constant spindle current: end and slot milling.

Tai, Tsai & Li 2023, IEEE Access, doi 10.1109/ACCESS.2023.3330587. The paper prints neither the coefficients of its load
line, nor a wear law, nor units of its gains: what stands here was worked out from its points, and its notes say how.

    A           0.1158 A by the three end-milling points; the spindle's, so slot milling has it too
    B           (0.24 A - A) over the sharp tool's feed at 0.24 A: 1000 and 600 mm/min
    k1 / B      feed lost by wear at 0.24 A: a line through the sharp tool's feed and all points held there
    VB = r t    r from the constant-feed runs, life and criterion in the table below
    scaling     G(1) / B in mm/min per V, as 1 mm/min must draw B
"""

from dataclasses import dataclass
from typing import Any, Final

from ...core.verdict import DO_NOT_USE
from ...core.version import __version__
from ..file import ParameterFile, sealed
from . import unchecked

SOURCE: Final = "Tai, Tsai & Li 2023, doi 10.1109/ACCESS.2023.3330587"
REFERENCE, WORN, SAFETY = 0.24, 0.28, 0.85  # A, A
B18, A18 = (0.0, 0.0611, -0.1338, 0.0752), (1.0, -2.0311, 1.2104, -0.1655)  # eq. 18
THREE = ((1000.0, 0.24, 0.0), (700.0, 0.24, 167.3), (600.0, 0.236, 205.1))  # mm/min, A, um: section III.A.1
KP, KI_PER_SAMPLE, PERIOD = 160.0, 0.006, 0.02
AVERAGE = 10  # samples, assumed: with it the loop still settles within the 4 s asked for, in both cuts
DWELL = 4.0  # s, assumed: the settling time asked for
DEPTH, WINDOW = 0.2, (180.0, 220.0)  # mm, um
NONE = {"kind": "none", "reason": "the paper prints points, no scatter of one tool"}


@dataclass(frozen=True, slots=True)
class MillingCase:
    """Printed data of one kind of milling; ``held`` are feed and wear at 0.24 A, ``criterion`` is assumed."""

    name: str
    sharp: float  # mm/min at 0.24 A
    low: float  # mm/min
    high: float
    width: float  # mm
    held: tuple[tuple[float, float], ...]  # mm/min, um
    feed: float  # mm/min of the constant-feed run
    length: float  # mm of its life
    criterion: float  # um


END = MillingCase(
    "end milling (down), ae 1.4 mm", 1000.0, 600.0, 1000.0, 1.4,
    ((700.0, 167.3), *((600.0, VB) for VB in (214.30, 175.29, 192.34, 198.59, 205.80))), 700.0, 1800.0, 200.0,
)  # fmt: skip
SLOT = MillingCase(
    "slot milling", 600.0, 500.0, 700.0, 2.0,
    tuple((500.0, VB) for VB in (185.0, 194.53, 178.89, 195.69)), 400.0, 1350.0, 185.0,
)  # fmt: skip


def end_milling(upper: float = END.high) -> ParameterFile:
    """End milling; ``upper`` is the upper feed limit, 1100 mm/min on the mixed path of Table 3.

    Examples
    --------
    >>> pf = end_milling()
    >>> round(pf.load_line.lower.wear), round(pf.pi.scaling_u)
    (201, 1459)
    """
    return _file(END, upper)


def slot_milling() -> ParameterFile:
    """Slot milling; the drive is that of end milling, the paper prints no other.

    Examples
    --------
    >>> pf = slot_milling()
    >>> round(pf.load_line.lower.wear), round(pf.pi.scaling_u)
    (189, 875)
    """
    return _file(SLOT, SLOT.high)


def _file(cut: MillingCase, upper: float) -> ParameterFile:
    A = idle()
    B = (REFERENCE - A) / cut.sharp
    slope = feed_lost(cut)
    sections: dict[str, object] = {
        "identity": {
            "tool": "AA238M-0200-D4-ML-10",
            "work": "S45C",
            "machine": "five-axis mill of the Precision Machinery Research Center",
            "iso513": "P",
            "iso13399": {"DC": 2.0, "ZEFP": 2, "FHA": 38.0},
            "setup": f"{cut.name}, ap 0.2 mm, 10000 rpm, passes of 150 mm",
            "sensors": [{"symbol": "I", "unit": "A", "model": "Fluke i-200s current clamp", "sample_rate": 50.0}],
            "simulated": False,
            "note": "Load line, wear law and scaling are worked out from printed points; see the notes.",
        },
        "laws": {"I": _load(cut, A, B, B * slope), "VB": _wear(cut)},
        "tool_life": _life(cut),
        "dynamics": _dynamics(),
        "pi": _pi(B),
        "load_line": _settings(cut, upper, slope),
        "provenance": {"fitmodels": __version__, "options": {"paper": "CLM-2023", "source": SOURCE}},
    }
    return sealed(ParameterFile.model_validate(sections))


def idle() -> float:
    """A in A, from the three points of section III.A.1, which fix A, B and k1 exactly."""
    (f0, I0, _), (f1, I1, w1), (f2, I2, w2) = THREE
    # I0 = A + B f0; the other two give I - I0 = B (f - f0) + k1 w
    B = ((I2 - I0) * w1 - (I1 - I0) * w2) / ((f2 - f0) * w1 - (f1 - f0) * w2)
    return I0 - B * f0


def feed_lost(cut: MillingCase) -> float:
    """k1/B in mm/min per um: least squares through the sharp tool's feed, over the points held at 0.24 A."""
    return sum((cut.sharp - feed) * VB for feed, VB in cut.held) / sum(VB * VB for _, VB in cut.held)


def _load(cut: MillingCase, A: float, B: float, k1: float) -> dict[str, Any]:
    own = cut is END
    return {
        "form": "load_line", "response": "I", "quantity": "spindle current", "unit": "A",
        "equation": f"I = {A:.6g} + {B:.6g} fm + {k1:.6g} VB", "error": "additive",
        "coefficients": {"A": A, "B": B, "k1": k1},
        "factors": [
            _factor("fm", "feed rate", "mm/min", cut.low, cut.sharp), _factor("VB", "flank wear", "um", 0.0,
                                                                             max(VB for _, VB in cut.held)),
        ],
        "uncertainty": NONE, "residual_scale": "A", "n": 1 + len(cut.held), "df": 0,
        "verdict": unchecked(
            "the paper prints points, no coefficients and no scatter",
            f"Three coefficients are worked out from {1 + len(cut.held)} printed points, so their error is not known.",
            level=DO_NOT_USE,
        ),
        "notes": [
            f"Form: {SOURCE}, eq. 14; no coefficient is printed.",
            "A by the three end-milling points of section III.A.1" + ("." if own else
            "; assumption: the same in slot milling, as A is the spindle's (eq. 12)."),
            f"B puts the sharp tool's {cut.sharp:g} mm/min at 0.24 A.",
            f"k1/B {feed_lost(cut):.4g} (mm/min)/um by the points held at 0.24 A, through {cut.sharp:g} mm/min.",
        ],
    }  # fmt: skip


def _wear(cut: MillingCase) -> dict[str, Any]:
    minutes = cut.length / cut.feed
    return {
        "form": "power", "response": "VB", "quantity": "flank wear", "unit": "um",
        "equation": f"VB = {cut.criterion / minutes:.6g} t", "error": "multiplicative",
        "coefficients": {"c0": cut.criterion / minutes, "t": 1.0, "fm": 0.0, "d": 0.0, "ae": 0.0},
        "factors": [
            _factor("t", "cutting time", "min", 0.0, minutes), _factor("fm", "feed rate", "mm/min", cut.feed, cut.feed),
            _factor("d", "depth of cut", "mm", DEPTH, DEPTH), _factor("ae", "width of cut", "mm", cut.width, cut.width),
        ],
        "uncertainty": NONE, "residual_scale": "ln", "n": 1, "df": 0,
        "verdict": unchecked(
            "the paper prints no wear law",
            "The law is one printed life with an assumed criterion; its exponents are assumed.",
            level=DO_NOT_USE,
        ),
        "notes": [
            "Assumption: wear grows with the time in the cut, whatever the feed; the paper prints no wear law.",
            f"Its rate is from the run at {cut.feed:g} mm/min, whose life is printed as {cut.length:g} mm; assumption: "
            f"that life ends at {cut.criterion:g} um, which is not printed.",
            "fm, d and ae were cut at one value each: an exponent of 0 is no finding.",
        ],
    }  # fmt: skip


def _factor(symbol: str, quantity: str, unit: str, low: float, high: float) -> dict[str, object]:
    return {"symbol": symbol, "quantity": quantity, "unit": unit, "low": low, "high": high}


def _life(cut: MillingCase) -> dict[str, Any]:
    minutes = cut.length / cut.feed
    return {
        "wear": "VB", "criterion": cut.criterion, "unit_of_wear": "um", "unit": "min", "coefficients": {"c0": minutes},
        "t_observed": minutes, "typical": minutes, "typical_at": {"fm": cut.feed},
        "verdict": unchecked(
            "the paper prints no wear law",
            "The life is that of one printed run, at an assumed criterion and one feed.",
            level=DO_NOT_USE,
        ),
    }  # fmt: skip


def _dynamics() -> dict[str, Any]:
    return {
        "structure": "arx", "b": B18, "a": A18, "nk": 1, "sample_time": PERIOD,
        "input": "feed voltage", "output": "spindle current", "unit_u": "V", "unit_y": "A", "band": (0.1, 2.0),
        "uncertainty": {"kind": "none", "reason": "eq. 18 is printed to four decimals, without errors"},
        "verdict": unchecked(
            "the paper prints neither the record nor errors of the coefficients",
            "Four decimals leave the static gain anywhere in 0.1685 to 0.1941 A/V.",
            "The gain does not agree with the load line: 2.5 V would be 0.45 A.",
        ),
        "notes": [
            f"{SOURCE}, eq. 18. Four decimals leave its gain at rest anywhere in 0.1685 to 0.1941 A/V.",
            "It does not agree in gain with the load line: 2.5 V would be 0.45 A. A replay takes its shape alone.",
        ],
    }  # fmt: skip


def _pi(B: float) -> dict[str, Any]:
    return {
        "kp": KP, "ki": KI_PER_SAMPLE / PERIOD, "sample_time": PERIOD, "form": "incremental_sum",
        "average": AVERAGE, "average_of": "command", "unit_u": "mm/min", "unit_y": "A",
        "scaling_u": sum(B18) / sum(A18) / B,
        "specification": {"rise_time": 2.0, "settling_time": 4.0, "steady_error": 0.0},
        "method": "MATLAB's PID Tuner",
        "notes": [
            "Kp 160 and Ki 0.006 are printed without units. Reconstruction: eq. 16 as it is worded, in mm/min, Ki per "
            "sample of 0.02 s.",
            "The scaling G(1)/B is derived, not printed.",
            f"The override is a moving average, its length not printed; assumption: {AVERAGE} samples.",
        ],
    }  # fmt: skip


def _settings(cut: MillingCase, upper: float, slope: float) -> dict[str, Any]:
    exact = {"kind": "none", "reason": "printed as a setting"}
    return {
        "reference": REFERENCE, "worn": WORN, "safety_factor": SAFETY, "rounded_to": 0.01,
        "unit_load": "A", "unit_feed": "mm/min", "unit_wear": "um", "law": "I", "window": WINDOW,
        "upper": {"value": upper, "wear": 0.0, "interval": exact},
        "lower": {"value": cut.low, "wear": (cut.sharp - cut.low) / slope, "interval": exact},
        "probability_of": "not had: tools' scatter is not printed",
        "dwell": DWELL,
        "engagement": {"load_low": 0.05, "load_high": 1.0},
        "notes": [
            f"Upper limit {upper:g} mm/min; the sharp tool holds 0.24 A at {cut.sharp:g}.",
            f"Assumption: the command rests on the lower limit for {DWELL:g} s before the tool is changed.",
            "Assumption: readings outside 0.05 to 1 A are invalid.",
        ],
    }  # fmt: skip
