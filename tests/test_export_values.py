"""Every number of the exports of values is the one that the parameter file states, read by the meaning of each format.

The expected values are written here from the sections of the file, not from the view that the exports are made of. One
changed digit in an export, of any number, must be seen.
"""

import re
from collections.abc import Callable, Iterator
from configparser import ConfigParser
from io import BytesIO
from xml.etree import ElementTree

import numpy as np
import pint
import pytest
from fitmodels.parameters.exports import VALUES
from fitmodels.parameters.exports.view import export_view
from fitmodels.parameters.file import sealed
from scipy.io import loadmat

Values = dict[str, float]
REGISTRY = pint.UnitRegistry()
NUMBER = r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?"
ROUNDING = 1e-12
SSP = "{http://ssp-standard.org/SSP1/SystemStructure"
UNITS = {  # of the quantities, as pint spells them
    "A": "A", "s": "s", "mm": "mm", "mm/min": "mm/min", "(mm/min)/A": "mm/min/A", "(mm/min)/A/s": "mm/min/A/s",
    "(mm/min)/(A)": "mm/min/A", "(mm/min)/(A)/s": "mm/min/A/s", "1/s": "1/s", "1/A": "1/A", "A/(V)": "A/V",
    "(A)/(mm/min)": "A/(mm/min)", "(A)/(mm)": "A/mm", "N": "N", "1": "",
}  # fmt: skip
BASES = {"kg": "kilogram", "m": "metre", "s": "second", "A": "ampere", "rad": "radian"}


@pytest.fixture(scope="module")
def full_file(constant_load_file):
    """A file in which no two settings of a loop have the same value, with a load law and a limit of force."""
    verdict = {"level": "usable inside the tested region"}
    law = {
        "quantity": "", "error": "additive", "residual_scale": "A", "n": 20, "df": 17, "form": "load_line",
        "uncertainty": {"kind": "none", "reason": "given"}, "response": "I", "unit": "A", "equation": "",
        "verdict": verdict, "coefficients": {"A": 0.1158, "B": 1.2416e-4, "k1": 0.29},
        "factors": [
            {"symbol": "fm", "quantity": "", "unit": "mm/min", "low": 610.0, "high": 990.0},
            {"symbol": "VB", "quantity": "", "unit": "mm", "low": 0.01, "high": 0.21},
        ],
    }  # fmt: skip
    engagement = {
        "feed_programmed": 1003.0, "engage_at": 0.151, "hysteresis": 0.021, "engage_after": 0.41, "back_off": 1.1,
        "recover": 0.42, "load_low": 0.023, "load_high": 9.5,
    }  # fmt: skip
    return constant_load_file(
        laws={"I": law}, load_line={"dwell": 3.9, "engagement": engagement},
        limits={"force": {"value": 1234.5, "unit": "N", "of": "Fxy"}},
    )  # fmt: skip


def content_of(pf, kind: str) -> str | bytes:
    return VALUES[kind].render(export_view(pf))


def meaning(pf) -> Values:
    """The numbers of the loop, the load line, the dynamics, the gains and the law by the sections of the file."""
    pi, line, model, law = pf.pi, pf.load_line, pf.dynamics, pf.laws["I"]
    settings, feed, wear = line.engagement, *law.factors
    return {
        "kp": pi.kp, "ki": pi.ki, "sample_time": pi.sample_time, "filter_time": pi.filter_time, "average": pi.average,
        "reference": line.reference, "feed_low": line.lower.value, "feed_high": line.upper.value,
        "feed_programmed": settings.feed_programmed, "engage_at": settings.engage_at,
        "hysteresis": settings.hysteresis, "engage_after": settings.engage_after, "back_off": settings.back_off,
        "recover": settings.recover, "load_low": settings.load_low, "load_high": settings.load_high,
        "worn_load": line.worn, "safety_factor": line.safety_factor, "dwell": line.dwell,
        "wear_low": line.window[0], "wear_high": line.window[1],
        "dynamics_sample_time": model.sample_time,
        **{f"dynamics_b{k}": value for k, value in enumerate(model.b)},
        **{f"dynamics_a{k}": value for k, value in enumerate(model.a)},
        "pi_kp": pi.kp, "pi_ki": pi.ki, "pi_sample_time": pi.sample_time, "pi_delay": pi.delay,
        "pi_filter_time": pi.filter_time, "pi_average": pi.average, "pi_setpoint_weight": pi.setpoint_weight,
        **{f"pi_{name}": value for name in ("low", "high", "rate", "tracking_time") if (value := getattr(pi, name))},
        **{f"law_i_{name.lower()}": value for name, value in law.coefficients.items()},
        "law_i_fm_low": feed.low, "law_i_fm_high": feed.high, "law_i_vb_low": wear.low, "law_i_vb_high": wear.high,
        "limits_force_value": pf.limits.force.value,
    }  # fmt: skip


class UnreadableError(Exception):
    """Text that a reader of the format does not take."""


def from_gcode(content: str | bytes) -> Values:
    """Named parameters; each numbered one must be the copy of the last named one, from 500 upwards."""
    named, number = {}, 500
    for line in str(content).splitlines():
        words = re.sub(r"\([^()]*\)", "", line).strip()
        given = re.fullmatch(rf"#<_fm_(\w+)>=({NUMBER})", words)
        copied = re.fullmatch(r"#(\d+)=#<_fm_(\w+)>", words)
        if given:
            named[given[1]] = float(given[2])
        elif copied and (int(copied[1]), copied[2]) == (number, list(named)[-1]):
            number += 1
        elif words not in ("", "%", "M52 P0", "M52 P1"):
            raise UnreadableError(line)
    return named


def from_ini(content: str | bytes) -> Values:
    ini = ConfigParser()
    ini.read_string(str(content))
    return {name: float(value) for name, value in ini["values"].items()}


def from_header(content: str | bytes) -> Values:
    lines = [line for line in re.sub(r"/\*.*?\*/", "", str(content)).splitlines() if line.strip()]
    found = [re.fullmatch(rf"static const double fm_(\w+) = ({NUMBER}); ?", line) for line in lines]
    if not all(match or line.startswith("#") for match, line in zip(found, lines, strict=True)):
        raise UnreadableError(content)
    return {match[1]: float(match[2]) for match in found if match}


def from_ssv(content: str | bytes) -> Values:
    """Values of the parameters; each declared unit must be what pint makes of its name."""
    root, registry = ElementTree.fromstring(content), REGISTRY  # noqa: S314  our own export
    for unit in root.iter(f"{SSP}Common}}Unit"):
        base = dict(next(iter(unit)).attrib)
        ours = registry.Quantity(float(base.pop("factor")), "")
        for name, power in base.items():
            ours = ours * registry.Unit(BASES[name]) ** int(power)
        theirs = registry.Quantity(1.0, UNITS.get(str(unit.get("name")), "lumen"))
        ratio = (ours / theirs).to_base_units()
        if not ratio.dimensionless or ratio.m != pytest.approx(1, abs=0, rel=ROUNDING):
            raise UnreadableError(unit.get("name"))
    found = root.iter(f"{SSP}ParameterValues}}Parameter")
    return {str(parameter.get("name")): float(str(next(iter(parameter)).get("value"))) for parameter in found}


READERS: dict[str, Callable[[str | bytes], Values]] = {
    "ngc": from_gcode, "ini": from_ini, "h": from_header, "ssv": from_ssv,
}  # fmt: skip


def faults(kind: str, content: str | bytes, pf) -> list[str]:
    """Numbers that a reader of the format finds otherwise than the file states them."""
    try:
        found = READERS[kind](content)
    except (UnreadableError, ValueError) as error:
        return [str(error)]
    return wrong_numbers(found, pf)


def wrong_numbers(found: Values, pf) -> list[str]:
    """A number without an entry in `meaning` is the default of its setting."""
    expected = meaning(pf) | {name: value for name, value in of_defaults(pf).items() if name not in meaning(pf)}
    return [f"{name}: {found.get(name)}" for name in expected.keys() | found.keys()
            if name not in found or found[name] != pytest.approx(expected.get(name), abs=0, rel=ROUNDING)]  # fmt: skip


def of_defaults(pf) -> Values:
    """Settings that the file leaves open, with the values that the documentation gives them."""
    kp = pf.pi.kp / pf.load_line.engagement.feed_programmed
    return {
        "arm_after": 0.5, "lost_after": 0.05, "stuck_after": 1.0, "heartbeat": 0.2, "overload_after": 0.5,
        "overload_at": 1.05 * pf.load_line.worn, "entry_gain": -(1 - pf.pi.setpoint_weight) * kp,
    }  # fmt: skip


@pytest.mark.parametrize("kind", READERS)
def test_every_number_is_the_one_that_the_file_states(full_file, kind):
    content = content_of(full_file, kind)
    assert faults(kind, content, full_file) == []
    assert len(READERS[kind](content)) > 40


def changed(kind: str, text: str) -> Iterator[str]:
    """The export with one number changed in its last or eighth digit, for each number that a reader uses."""
    active = {
        "ngc": rf"(?<==){NUMBER}|(?<=^#)\d+", "ini": rf"(?<= = ){NUMBER}$", "h": rf"(?<= = ){NUMBER}(?=;)",
        "ssv": rf'(?<=value="){NUMBER}|(?<=factor="){NUMBER}|(?<= (?:m|s|A)=")-?\d+',
    }  # fmt: skip
    end = text.index("[units]") if kind == "ini" else len(text)
    start = text.index("[values]") if kind == "ini" else 0
    for match in re.compile(active[kind], re.MULTILINE).finditer(text, start, end):
        digits, exponent, power = match[0].partition("e")
        last = min(len(digits), 8) - 1  # a digit that is not rounding
        other = f"{digits[:last]}{(int(digits[last]) + 1) % 10}{digits[last + 1 :]}{exponent}{power}"
        yield f"{text[: match.start()]}{other}{text[match.end() :]}"


@pytest.mark.parametrize("kind", READERS)
def test_one_changed_digit_of_any_number_is_seen(full_file, kind):
    mutants = list(changed(kind, str(content_of(full_file, kind))))
    assert len(mutants) > 40
    assert [mutant for mutant in mutants if not faults(kind, mutant, full_file)] == []


# the struct of MATLAB


def transfer(num: np.ndarray, den: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Polynomials in z^-1."""
    return np.polyval(num[::-1], 1 / z) / np.polyval(den[::-1], 1 / z)


def struct_agrees(struct: dict, pf) -> bool:
    """Whether plant and PI of the struct have the frequency response of the file's sections, and its values agree."""
    pi, model = pf.pi, pf.dynamics
    z = np.exp(1j * np.linspace(0.01, 3.0, 40))
    by = 1 / pi.scaling_u  # gains in the units of the dynamics
    low_pass = -np.expm1(-pi.sample_time / pi.filter_time)
    expected = {
        "plant": np.polyval(model.b[::-1], 1 / z) / np.polyval(model.a[::-1], 1 / z),
        "C": by * (pi.kp + pi.ki * pi.sample_time * z / (z - 1)),  # rectangle that ends now
        "H": low_pass / (1 - (1 - low_pass) / z),
    }
    gains, plant = struct["pi"], struct["plant"]
    found = {
        "plant": transfer(plant["num"], plant["den"], z),
        "C": transfer(gains["C_num"], gains["C_den"], z), "H": transfer(gains["H_num"], gains["H_den"], z),
    }  # fmt: skip
    if not all(np.allclose(found[name], expected[name], rtol=1e-9, atol=0) for name in expected):
        return False
    numbers = (plant["nk"], plant["Ts"], gains["Ts"], gains["Kp"], gains["Ki"], gains["filter_time"], gains["delay"])
    stated = (model.nk, model.sample_time, pi.sample_time, pi.kp * by, pi.ki * by, pi.filter_time, pi.delay)
    units = {"low": by, "high": by, "rate": by, "tracking_time": 1.0, "setpoint_weight": 1.0}
    set_up = {name: value for name in units if (value := getattr(pi, name)) is not None}
    return (
        np.allclose(numbers, stated, rtol=ROUNDING, atol=0)
        and all(gains.get(name) == pytest.approx(value * units[name]) for name, value in set_up.items())
        and gains["average"] == pi.average
        and wrong_numbers(struct["quantities"], pf) == []
    )


def test_the_struct_of_matlab_states_the_file_and_one_changed_number_of_it_is_seen(full_file):
    content = content_of(full_file, "mat")
    assert isinstance(content, bytes)
    struct = loadmat(BytesIO(content), simplify_cells=True)["fitmodels"]
    assert struct_agrees(struct, full_file)
    tried = 0
    for section in ("plant", "pi", "quantities"):
        for name, value in struct[section].items():
            if isinstance(value, str):
                continue
            for place in range(np.size(value)):
                other = np.array(value, dtype=float)
                other.flat[place] = other.flat[place] * 1.001 + 1e-6
                assert not struct_agrees({**struct, section: {**struct[section], name: other}}, full_file), name
                tried += 1
    assert tried > 60


# G-code


def test_the_program_switches_adaptive_feed_off_for_rapids_and_on_for_the_cut(full_file):
    """M52 scales rapids as well; at the end of the exported lines it is on, or a cut below them is not controlled."""
    text = str(content_of(full_file, "ngc"))
    assert re.findall(r"^M52 P\d|^\(fm - write G\d", text, re.MULTILINE) == [
        "M52 P0", "(fm - write G0", "M52 P1", "(fm - write G1"
    ]  # fmt: skip
    assert "cut with F 1003 mm/min, in G94 and G21" in text


def test_limits_and_weight_of_the_gains_are_exported(full_file):
    """Only kp, ki, sample time and delay were: a program ran the gains without what they were tuned for."""
    set_up = {
        "low": 1.0,
        "high": 9000.0,
        "rate": 4000.0,
        "average": 4,
        "setpoint_weight": 0.5,
        "tracking_time": 2.0,
    }
    pf = sealed(full_file, pi={**full_file.pi.model_dump(), **set_up})
    found = from_ini(content_of(pf, "ini"))
    assert {name: found[f"pi_{name}"] for name in set_up} == set_up
    assert "anti-windup" in str(content_of(pf, "ini"))
    struct = loadmat(BytesIO(content_of(pf, "mat")), simplify_cells=True)["fitmodels"]
    assert struct["pi"]["rate"] == pytest.approx(4000.0 / pf.pi.scaling_u)
    assert struct["pi"]["anti_windup"] == pf.pi.anti_windup
