"""The G-code export, run by LinuxCNC's own interpreter (`rs274 -g`), and the ini export, read by configparser."""

import math
import re
import subprocess
from configparser import ConfigParser, DuplicateOptionError, Error, RawConfigParser
from dataclasses import replace
from decimal import Decimal

import pytest
from fitmodels import parameters
from fitmodels.datasets.units import canonical
from fitmodels.parameters.exports import export_format
from fitmodels.parameters.exports.quantities import Quantity
from fitmodels.parameters.exports.text_formats import fixed
from fitmodels.parameters.exports.view import export_view
from hypothesis import given
from hypothesis import strategies as st

INSTALL = "apt-get install linuxcnc-uspace"
PRINTED = 6  # decimals of rs274


def ngc_of(pf) -> str:
    return export_format("ngc").render(export_view(pf))


@pytest.fixture
def rs274(consumer, tmp_path):
    program = consumer("rs274", INSTALL)

    def run(text: str) -> subprocess.CompletedProcess[str]:
        (tmp_path / "test.ngc").write_text(text)
        return subprocess.run([program, "-g", "test.ngc"], cwd=tmp_path, capture_output=True, text=True, timeout=60)

    return run


def scale(value: float) -> int:
    """Power of ten that leaves a value of 1 to 10 for the six decimals that are printed."""
    return math.floor(math.log10(abs(value))) if value else 0


@pytest.mark.consumer
def test_every_value_arrives_under_its_name_and_its_number(rs274, constant_load_file):
    pf = constant_load_file()
    quantities = export_view(pf).quantities
    asked = "".join(
        f"(DEBUG,{q.name} #{9 + 2 * k})\n(DEBUG,{q.name} #{10 + 2 * k})\n" for k, q in enumerate(quantities)
    )
    copies = "".join(
        f"#{9 + 2 * k}=[#<_fm_{q.name}>/{fixed(float(Decimal(10) ** scale(q.value)))}]\n"
        f"#{10 + 2 * k}=[#{500 + k}/{fixed(float(Decimal(10) ** scale(q.value)))}]\n"
        for k, q in enumerate(quantities)
    )
    text = ngc_of(pf).removesuffix("%\n") + copies + asked + "%\n"
    said = rs274(text)
    assert said.returncode == 0, said.stderr
    printed = re.findall(r'MESSAGE\("(\w+) (-?[\d.]+)"\)', said.stdout)
    expected = [(q.name, f"{q.value / 10.0 ** scale(q.value):.{PRINTED}f}") for q in quantities for _ in (1, 2)]
    assert [name for name, _ in printed] == [name for name, _ in expected]
    for (name, ours), (_, theirs) in zip(expected, printed, strict=True):
        assert float(theirs) == pytest.approx(float(ours), abs=2 * 10.0**-PRINTED), name
    assert "ENABLE_ADAPTIVE_FEED()" in said.stdout


@pytest.mark.consumer
@pytest.mark.parametrize(
    ("broken", "by"),
    [("#<_fm_kp>=300", "#<_fm_kp>=3e2"), ("(fm - ", "(fm ("), ("\nM52 P1", "\nM52 P"), ("#<_fm_ki>=", "#<_fm_ki=")],
)
def test_a_broken_file_does_not_run(rs274, constant_load_file, broken, by):
    text = ngc_of(constant_load_file())
    assert broken in text
    assert rs274(text).returncode == 0
    assert rs274(text.replace(broken, by, 1)).returncode != 0


@pytest.mark.consumer
def test_rapids_run_without_adaptive_feed_and_cuts_with_it(rs274, constant_load_file):
    """The program of the exported pattern: a move written where its lines say so."""
    text = (
        ngc_of(constant_load_file())
        .replace("(fm - write G0 here)", "G0 X1")
        .replace("(fm - write G1 here", "G1 X2 F1000 (")
    )
    order = re.findall(
        r"DISABLE_ADAPTIVE_FEED|ENABLE_ADAPTIVE_FEED|STRAIGHT_TRAVERSE|STRAIGHT_FEED", rs274(text).stdout
    )
    moves = ["DISABLE_ADAPTIVE_FEED", "STRAIGHT_TRAVERSE", "ENABLE_ADAPTIVE_FEED", "STRAIGHT_FEED"]
    assert order[: len(moves)] == moves


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_has_no_exponent_and_reads_back_to_the_same_float(value):
    text = fixed(value)
    assert re.fullmatch(r"-?\d+(\.\d+)?", text)
    assert float(text) == value


def test_no_line_is_longer_than_linuxcnc_reads(constant_load_file):
    pf = constant_load_file(identity={"tool": "x" * 500, "work": "y" * 500})
    assert max(len(line) for line in ngc_of(pf).splitlines()) < 255


# The ini export


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
