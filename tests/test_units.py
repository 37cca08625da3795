"""Units: every spelling reaches its unit, factors are the published ones, nothing unlisted is guessed.

Factors: NIST Special Publication 811 (2008), appendix B.8; BIPM, The International System of Units, 9th ed.
"""

import subprocess
import sys
from itertools import combinations

import numpy as np
import pint
import pytest
from fitmodels.core.errors import DataError, UsageError
from fitmodels.datasets import units
from fitmodels.datasets.units import SPELLINGS, ZERO_POINT, canonical, convert, is_unit, same_dimension, suggest
from hypothesis import given, settings
from hypothesis import strategies as st

THERE_AND_BACK = 1e-12  # four roundings of a double are below 1e-15; three decades to spare
ZERO_POINTS = 1e-11  # K: scales of temperature differ in their zero, up to 459.67
PAIRS = [
    (a, b) for a, b in combinations(SPELLINGS, 2) if same_dimension(a, b)
]  # 60 or so; every convertible pair, once
NUMBERS = st.floats(min_value=1e-6, max_value=1e6)


@pytest.mark.parametrize(("unit", "spellings"), SPELLINGS.items())
def test_every_listed_spelling_reaches_its_unit(unit, spellings):
    assert canonical(unit) == unit
    assert [s for s in spellings if canonical(s) != unit or canonical(f" [{s}] ") != unit] == []


def test_no_two_units_share_a_spelling():
    keys = [(units._key(s), unit) for unit, all_ in SPELLINGS.items() for s in all_]
    assert len({key for key, _ in keys}) == len(set(keys))


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("m min-1", "m/min"),
        ("m·min⁻¹", "m/min"),
        ("m*min^-1", "m/min"),
        ("m ⋅ min −1", "m/min"),
        ("m/mn", "m/min"),
        ("in m/min", "m/min"),
        ("(m/min)", "m/min"),
        ("m/(min)", "m/min"),
        ("/ m/min", "m/min"),
        ("SFM", "sfm"),
        ("ft/min", "sfm"),
        ("mm/Umdr.", "mm/rev"),
        ("mm pro Umdrehung", "mm/rev"),
        ("mm per rev", "mm/rev"),
        ("IPR", "in/rev"),
        ("mm/Zahn", "mm/tooth"),
        ("mm/diente", "mm/tooth"),
        ("MM/MIN", "mm/min"),
        ("U/min", "1/min"),
        ("tr/mn", "1/min"),
        ("min⁻¹", "1/min"),
        ("/min", "1/min"),
        ("µm", "um"),  # U+00B5 micro sign
        ("μm", "um"),  # U+03BC Greek mu
        ("µin", "uin"),
        ('"', "in"),
        ("in.", "in"),
        ("in", "in"),
        ("in min", "min"),
        ("in lbf", "in lbf"),
        ("N.m", "Nm"),
        ("N·m", "Nm"),
        ("N×m", "Nm"),
        ("mm³ / min", "mm3/min"),
        ("mm**3/min", "mm3/min"),
        ("ccm/min", "cm3/min"),
        ("cu.in./min", "in3/min"),
        ("N/mm²", "N/mm2"),
        ("Mpa", "MPa"),
        ("RPM", "1/min"),
        ("Inch", "in"),
        ("℃", "degC"),
        ("º", "deg"),
        ("–", "1"),
        ("[-]", "1"),
        ("per cent", "%"),
    ],
)
def test_forgiven_forms(text, unit):
    assert canonical(text) == unit


@pytest.mark.parametrize(
    "text", ["mN", "MN", "mPa", "v", "M", "nm", "µN", "n", "a", "furlong", "min m", "mm/", "VU", "Nm/s"]
)
def test_what_is_not_listed_is_no_unit(text):
    assert canonical(text) is None
    assert not is_unit(text)


def test_spellings_that_unit_libraries_misread():
    """pint 0.25 reads Nm as a number times a metre, and mm/U as millimetres per enzyme unit."""
    np.testing.assert_array_equal(convert(np.array([2.0]), "Nm", "Ncm"), [200.0])
    np.testing.assert_array_equal(convert(np.array([0.01]), "in/rev", "mm/U"), [0.254])


@pytest.mark.parametrize("text", ["furlong", "enzyme_unit", "meter**2", "number_meter", "mm/X", "__import__('os')"])
def test_an_unlisted_spelling_is_refused(text):
    with pytest.raises(UsageError, match="is not listed"):
        convert(np.ones(2), text, "mm")
    with pytest.raises(UsageError, match="is not listed"):
        same_dimension("mm", text)


PINT = {  # names of pint for units that it spells differently
    "sfm": "ft/min", "um": "micrometer", "um/rev": "micrometer/turn", "mil": "inch/1000", "uin": "inch/1000000",
    "rev/s": "turn/s", "in": "inch", "PS": "metric_horsepower", "daN": "decanewton", "in3/min": "inch**3/min",
    "ft lbf": "ft*lbf", "in lbf": "inch*lbf", "Nm": "N*m", "Ncm": "N*cm", "Nmm": "N*mm", "mm2": "mm**2",
    "mm3/min": "mm**3/min", "mm3/s": "mm**3/s", "cm3/min": "cm**3/min", "N/mm2": "N/mm**2", "1/min": "turn/min",
    "mm/rev": "mm/turn", "in/rev": "inch/turn", "in/min": "inch/min", "%": "percent", "1": "",
}  # fmt: skip
OWN = {
    "mm/tooth",
    "in/tooth",
    "um/tooth",
    "HRC",
    "HB",
    "HV",
    "deg",
    "degC",
    "degF",
    "K",
}  # of their own dimension or scale


def test_factors_are_those_of_pint():
    """Every pair of units of one dimension, against the default registry of pint."""
    registry = pint.UnitRegistry()
    base = {unit: registry.Quantity(1.0, "") * registry(PINT.get(unit, unit)) for unit in SPELLINGS if unit not in OWN}
    pairs = [(a, b) for a, b in combinations(base, 2) if same_dimension(a, b)]
    assert len(pairs) > 80
    for a, b in pairs:
        np.testing.assert_allclose(convert(np.ones(1), a, b)[0], (base[a] / base[b]).to("").magnitude, rtol=1e-9)


@pytest.mark.parametrize(
    ("one", "unit", "value"),
    [
        ("in", "mm", 25.4),
        ("mil", "mm", 0.0254),
        ("uin", "um", 0.0254),
        ("sfm", "m/min", 0.3048),
        ("ipm", "mm/min", 25.4),
        ("ipr", "mm/rev", 25.4),
        ("lbf", "N", 4.4482216152605),
        ("kgf", "N", 9.80665),
        ("hp", "W", 745.6998715822702),
        ("PS", "W", 735.49875),
        ("ft lbf", "Nm", 1.3558179483314004),
        ("in lbf", "Nm", 0.1129848290276167),
        ("in3/min", "mm3/min", 16387.064),
        ("mm/s", "mm/min", 60.0),
        ("m/s", "m/min", 60.0),
        ("U/min", "rev/s", 1 / 60),
        ("bar", "MPa", 0.1),
        ("N/mm2", "MPa", 1.0),
        ("h", "min", 60.0),
        ("daN", "N", 10.0),
        ("%", "1", 0.01),
        ("cm3/min", "mm3/min", 1000.0),
        ("mV", "V", 0.001),
        ("kHz", "Hz", 1000.0),
    ],
)
def test_published_factors_to_the_last_bit(one, unit, value):
    assert convert(np.array([1.0]), one, unit)[0] == value


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ("mm/rev", "mm"),
        ("mm/rev", "mm/tooth"),
        ("mm/rev", "mm/min"),
        ("1/min", "Hz"),
        ("HRC", "HB"),
        ("HB", "HV"),
        ("degC", "1"),
        ("deg", "1"),
        ("Nm", "N"),
        ("V", "m/min"),
    ],
)
def test_quantities_that_must_not_mix(a, b):
    assert not same_dimension(a, b)
    with pytest.raises(DataError, match="measures another quantity"):
        convert(np.ones(2), a, b)


def test_scales_of_temperature_have_different_zeros():
    """NIST SP 811, appendix B.8: t/degC = (t/degF - 32)/1.8; T/K = t/degC + 273.15."""
    np.testing.assert_allclose(convert(np.array([212.0, -40.0]), "°F", "°C"), [100, -40], atol=1e-12)
    np.testing.assert_allclose(convert(np.array([300.0]), "K", "degC"), [26.85], atol=1e-12)


@pytest.mark.parametrize("unit", SPELLINGS)
def test_the_same_unit_returns_the_values_themselves(unit):
    values = np.array([1.0, np.nan])
    assert convert(values, unit, unit) is values


def test_shape_is_kept_and_the_callers_values_stay():
    values = np.arange(6.0).reshape(2, 3)
    reported = convert(values, "in", "mm")
    assert reported.shape == (2, 3)
    np.testing.assert_array_equal(values, np.arange(6.0).reshape(2, 3))


@settings(deadline=None)
@given(st.sampled_from(PAIRS), NUMBERS)
def test_there_and_back(pair, number):
    a, b = pair
    back = convert(convert(np.array([number]), a, b), b, a)
    np.testing.assert_allclose(back, number, rtol=THERE_AND_BACK, atol=ZERO_POINTS * (a in ZERO_POINT))


@settings(deadline=None)
@given(st.data(), NUMBERS)
def test_factors_compose(data, number):
    a, b = data.draw(st.sampled_from(PAIRS))
    c = data.draw(st.sampled_from([u for u in SPELLINGS if same_dimension(a, u)]))
    by_way_of_b = convert(convert(np.array([number]), a, b), b, c)
    straight = convert(np.array([number]), a, c)
    np.testing.assert_allclose(by_way_of_b, straight, rtol=THERE_AND_BACK, atol=ZERO_POINTS * (a in ZERO_POINT))


@settings(deadline=None)
@given(st.text(max_size=12))
def test_any_text_is_read_or_refused_quietly(text):
    unit = canonical(text)
    assert unit is None or canonical(unit) == unit


def test_did_you_mean():
    assert suggest("mm/revv") == "did you mean mm/rev?"
    assert suggest("m/mim") == "did you mean m/min?"
    assert suggest("furlong").startswith("known are for example m/min")
    with pytest.raises(UsageError, match=r"^unit 'mm/revv' is not listed; did you mean mm/rev\?$"):
        same_dimension("mm/revv", "mm")


def test_threads_convert_at_once():
    script = (
        "from concurrent.futures import ThreadPoolExecutor\n"
        "import numpy as np\n"
        "from fitmodels.datasets import units\n"
        "to = {'m/s': 'm/min', 'sfm': 'm/min', 'in': 'mm', 'mil': 'mm', 'kN': 'N', 'lbf': 'N', 'hp': 'kW'}\n"
        "names = 3 * list(to)\n"
        "with ThreadPoolExecutor(8) as pool:\n"
        "    found = list(pool.map(lambda name: units.convert(np.ones(1), name, to[name])[0], names))\n"
        "exact = [60.0, 0.3048, 25.4, 0.0254, 1000.0, 4.4482216152605, 0.74569987158227022]\n"
        "np.testing.assert_allclose(found, 3 * exact, rtol=1e-12)\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True, timeout=60)
