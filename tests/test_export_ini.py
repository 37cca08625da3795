"""The ini export, read by Python's configparser as it comes."""

from configparser import ConfigParser, DuplicateOptionError, Error, RawConfigParser
from dataclasses import replace

import pytest
from fitmodels import parameters
from fitmodels.datasets.units import canonical
from fitmodels.parameters.exports import export_format
from fitmodels.parameters.exports.quantities import Quantity
from fitmodels.parameters.exports.view import export_view
from hypothesis import given
from hypothesis import strategies as st


def ini_of(pf) -> str:
    return export_format("ini").render(export_view(pf))


@pytest.mark.parametrize("reader", [ConfigParser, RawConfigParser])
def test_every_value_reads_back_exactly_with_its_unit_and_words(constant_load_file, reader):
    pf = constant_load_file()
    ini = reader()
    ini.read_string(ini_of(pf))
    quantities = export_view(pf).quantities
    assert [(k, float(v)) for k, v in ini["values"].items()] == [(q.name, q.value) for q in quantities]
    assert dict(ini["units"]) == {q.name: q.unit for q in quantities}
    assert dict(ini["words"]) == {q.name: q.words for q in quantities}
    assert ini["about"]["tool"] == "GC435"
    assert ini.getboolean("about", "simulated")


def test_a_file_written_as_json_and_read_again_gives_the_same_text(constant_load_file, tmp_path):
    pf = constant_load_file()
    again = parameters.read(parameters.write(pf, tmp_path / "params.json"))
    assert ini_of(again) == ini_of(pf)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_any_number_reads_back_to_the_same_float(seen, value):
    ini = ConfigParser()
    ini.read_string(export_format("ini").render(replace(seen, quantities=(Quantity("x", value, "%", "drawn"),))))
    assert float(ini["values"]["x"]) == value
    assert canonical(ini["units"]["x"]) == "%"


@pytest.fixture(scope="module")
def seen(constant_load_file):
    return export_view(constant_load_file())


@pytest.mark.parametrize(
    ("broken", "by"), [("[about]\n", ""), ("\nki = ", "\nkp = "), ("[units]", "[values]"), ("kp = 300.0", "kp")]
)
def test_a_broken_one_is_refused(constant_load_file, broken, by):
    text = ini_of(constant_load_file())
    assert broken in text
    with pytest.raises(Error):
        ConfigParser().read_string(text.replace(broken, by, 1))


def test_no_key_stands_twice_though_keys_have_no_case(constant_load_file):
    doubled = ini_of(constant_load_file()) + "KP = 1\nkp = 2\n"
    with pytest.raises(DuplicateOptionError):
        ConfigParser().read_string(doubled)
