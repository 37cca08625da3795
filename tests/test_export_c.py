"""The C header, compiled with every warning an error; a program that includes it prints the same doubles."""

import struct
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from fitmodels.parameters.exports import export_format
from fitmodels.parameters.exports.quantities import Quantity
from fitmodels.parameters.exports.view import export_view

INSTALL = "apt-get install gcc libc6-dev"
STRICT = ["-Wall", "-Wextra", "-Werror", "-pedantic"]


def header_of(pf) -> str:
    return export_format("h").render(export_view(pf))


def program(names: list[str]) -> str:
    """Includes the header twice, and prints each value in 17 digits, which tell a double."""
    lines = "".join(f'    printf("{name} %.17g\\n", fm_{name});\n' for name in names)
    include = '#include "params.h"\n'
    return f"#include <stdio.h>\n{include}{include}int main(void)\n{{\n{lines}    return 0;\n}}\n"


@pytest.fixture
def compiled(consumer, tmp_path):
    cc = consumer("cc", INSTALL)

    def run(header: str, names: list[str], language: str = "-std=c99", with_: str = cc) -> dict[str, float] | None:
        """What the program prints; None where the header does not compile."""
        (tmp_path / "params.h").write_text(header)
        source = tmp_path / ("main.cpp" if "++" in language else "main.c")
        source.write_text(program(names))
        made = subprocess.run(
            [with_, *STRICT, language, source.name, "-o", "main"], cwd=tmp_path, capture_output=True, text=True
        )
        if made.returncode:
            assert "error" in made.stderr
            return None
        said = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True).stdout
        return {name: float(value) for name, value in (line.split() for line in said.splitlines())}

    return run


@pytest.mark.consumer
@pytest.mark.parametrize("language", ["-std=c89", "-std=c99", "-std=c11", "-std=c++11"])
def test_a_program_prints_every_value_back_exactly(compiled, consumer, constant_load_file, language):
    pf = constant_load_file()
    values = {q.name: q.value for q in export_view(pf).quantities}
    with_ = consumer("c++" if "++" in language else "cc", "apt-get install g++")
    assert compiled(header_of(pf), list(values), language, with_) == values


@pytest.mark.consumer
def test_any_double_comes_back_bit_for_bit(compiled, constant_load_file):
    drawn = np.random.default_rng(5).integers(0, 2**64, 400, dtype=np.uint64).view(np.float64)
    values = drawn[np.isfinite(drawn)].tolist()
    values += [0.1, 1 / 3, -0.0, 5e-324, 2.2250738585072014e-308, 1.7976931348623157e308, 1e22, 1e-5]
    given = tuple(Quantity(f"x{k}", v, "1", "drawn") for k, v in enumerate(values))
    header = export_format("h").render(replace(export_view(constant_load_file()), quantities=given))
    back = compiled(header, [q.name for q in given])
    assert [struct.pack("<d", back[q.name]) for q in given] == [struct.pack("<d", q.value) for q in given]


@pytest.mark.consumer
@pytest.mark.parametrize(
    ("broken", "by"),
    [("#ifndef", "#ifdef"), (" = 300.0;", " = 300.0"), (" */", ""), ("fm_kp", "fm kp"), ("#endif", ""),
     ("300.0", "3,0"), ("static const double fm_kp", "double fm_kp = 1.0; static const double fm_kp")],
)  # fmt: skip
def test_a_broken_header_does_not_compile(compiled, constant_load_file, broken, by):
    header = header_of(constant_load_file())
    assert broken in header
    assert compiled(header, ["kp"]) is not None
    assert compiled(header.replace(broken, by, 1), ["kp"]) is None


@pytest.mark.consumer
@pytest.mark.parametrize("name", ["*/ #include </etc/passwd> /*", "x\\\n#error", "??/", "/* //", "int", '"%n%s'])
def test_a_nasty_name_compiles_as_a_comment(compiled, constant_load_file, name):
    pf = constant_load_file(identity={"tool": name, "work": name, "machine": name})
    assert compiled(header_of(pf), ["kp", "ki"]) == {"kp": 300.0, "ki": 8000.0}


def test_every_value_stands_beside_its_unit(constant_load_file):
    pf = constant_load_file()
    lines = {line.split()[3]: line for line in header_of(pf).splitlines() if line.startswith("static")}
    for q in export_view(pf).quantities:
        assert f"/* {q.unit}: " in lines[f"fm_{q.name}"]
