"""The SSV export, read by FMPy and held against the schema of SSP 1.0 that FMPy brings; units against pint's own."""

import importlib
import os
from dataclasses import replace
from xml.etree import ElementTree

import pint
import pytest
from fitmodels.parameters.exports import export_format
from fitmodels.parameters.exports.quantities import Quantity
from fitmodels.parameters.exports.ssv import si_unit
from fitmodels.parameters.exports.view import export_view

SPACES = {
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
}
BASES = {"kg": "kilogram", "m": "metre", "s": "second", "A": "ampere", "rad": "radian"}


def ssv_of(pf) -> str:
    return export_format("ssv").render(export_view(pf))


@pytest.fixture(scope="module")
def read_ssv(tmp_path_factory):
    """Read with FMPy, which checks the schema and gives parameters with texts."""
    try:
        fmpy = importlib.import_module("fmpy.ssp.ssd")
    except ImportError:
        missing = "FMPy is not installed: pip install FMPy"
        pytest.fail(missing) if os.environ.get("FITMODELS_REQUIRE_CONSUMERS") == "1" else pytest.skip(missing)
    path = tmp_path_factory.mktemp("ssv") / "params.ssv"

    def read(text: str):
        path.write_text(text)
        return fmpy.read_ssv(str(path))

    return read


def declared(text: str) -> dict[str, dict[str, str]]:
    root = ElementTree.fromstring(text)  # noqa: S314  our own export
    return {u.get("name"): u.find("ssc:BaseUnit", SPACES).attrib for u in root.iterfind(".//ssc:Unit", SPACES)}


@pytest.mark.consumer
def test_fmpy_reads_every_value_with_a_unit_that_is_declared(read_ssv, constant_load_file):
    pf = constant_load_file()
    found, units = read_ssv(ssv_of(pf)), declared(ssv_of(pf))
    read = [(p.name, p.type, float(p.value), p.unit) for p in found.parameters]
    assert read == [(q.name, "Real", q.value, q.unit) for q in export_view(pf).quantities]
    assert {unit for _, _, _, unit in read} == set(units)
    assert found.name == "gc435_s45c"


@pytest.mark.consumer
@pytest.mark.parametrize(
    ("broken", "by"),
    [("</ssv:Parameters>", ""), (' version="1.0" g', " g"), ('value="300.0"', 'value="3,0"'), ("ssv:Real", "ssv:Float"),
     ('name="kp" ', ""), (' m="1"', ' m="1.5"'), ("ssc:BaseUnit", "ssc:Base")],
)  # fmt: skip
def test_fmpy_refuses_a_broken_one(read_ssv, constant_load_file, broken, by):
    text = ssv_of(constant_load_file())
    assert broken in text
    with pytest.raises(Exception, match=r"validate|mismatch|tag|attribute"):
        read_ssv(text.replace(broken, by))


@pytest.mark.parametrize(
    "unit",
    ["mm/min", "um", "A", "mm", "s", "1/s", "1", "(mm/min)/A", "(mm/min)/A/s", "A/(V)", "(mm/min)/(A)/s", "N", "kW",
     "Nm", "MPa", "N/mm2", "1/(m/min)", "mm/rev", "deg", "(N)/(mm/rev)", "%", "in", "lbf", "mm3/min", "Hz", "hp"],
)  # fmt: skip
def test_a_unit_in_si_is_what_pint_makes_of_it(unit):
    registry = pint.UnitRegistry()
    spelled = {"%": "percent", "Nm": "N*m", "N/mm2": "N/mm**2", "mm3/min": "mm**3/min", "lbf": "force_pound",
               "mm/rev": "mm/revolution", "(N)/(mm/rev)": "N/(mm/revolution)"}  # fmt: skip
    theirs = registry.Quantity(1, registry.parse_units(spelled.get(unit, unit if unit != "1" else "")))
    ours = si_unit(unit)
    back = registry.Quantity(ours.factor, "")
    for base, power in ours.powers:
        back = back * registry.Unit(BASES[base]) ** power
    assert back.to_base_units().units == theirs.to_base_units().units
    assert back.to_base_units().magnitude == pytest.approx(theirs.to_base_units().magnitude, rel=1e-14)


@pytest.mark.parametrize("unit", ["HRC", "furlong", "(mm/min", "A/", "/", "", "mm/min)/(A", "N/HRC", "((", ")("])
def test_what_has_no_si_form_is_not_passed_off_as_a_number(unit, constant_load_file):
    assert si_unit(unit) is None
    seen = replace(export_view(constant_load_file()), quantities=(Quantity("x", 1.0, unit, "something"),))
    text = export_format("ssv").render(seen)
    assert "unit=" not in text
    assert declared(text) == {}
    assert f"something, in {unit}" in text


@pytest.mark.consumer
def test_a_file_without_gains_is_read_too(read_ssv, constant_load_file):
    bare = constant_load_file(pi=None, load_line=None, dynamics=None, laws=None)
    assert read_ssv(ssv_of(bare)).parameters == []
