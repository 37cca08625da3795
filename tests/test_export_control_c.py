"""The controller in C, alone, as LinuxCNC component and as FMU, is `controllers.ConstantLoad` sample by sample."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from fitmodels.controllers.exports import rendered
from fitmodels.controllers.exports.c_source import c_controller
from fitmodels.parameters.exports.loop import loop_settings

sys.path.insert(0, str(Path(__file__).parent))

from load_control import DRIVER, OUTPUTS, STRICT, compiled, reference, sequence, variants

sys.path.remove(str(Path(__file__).parent))

INSTALL = "apt-get install gcc libc6-dev"
DOUBLE, SINGLE = 1e-12, 1e-4  # of an override; the closing condition of the requirement, measured 0 and 1.2e-6
NAMES = ("position", "stop, feed-forward", "average of the load", "average of the command", "incremental sum",
         "incremental sum, average", "shortest times", "limits below 1")  # fmt: skip
FLOAT = ("-DLOAD_CONTROL_REAL=float", "-Wdouble-promotion")


@pytest.fixture
def loop(constant_load_file):
    return loop_settings(constant_load_file()).loop


def test_the_sequences_reach_every_state_and_every_output(loop):
    reached = np.concatenate(
        [reference(each, sequence(each, seed)) for seed, each in enumerate(variants(loop).values())]
    )
    assert set(reached[:, 2]) == {0, 1, 2, 3, 4, 5}
    assert (reached[:, 3:].mean(0) > 0.01).all(), dict(zip(OUTPUTS, reached.mean(0), strict=True))
    assert (reached[:, 2] == 3).mean() > 0.1


@pytest.mark.consumer
@pytest.mark.parametrize("name", NAMES)
def test_double_precision_is_the_python_controller_and_single_close_to_it(consumer, loop, tmp_path, name):
    cc, seed = consumer("cc", INSTALL), NAMES.index(name)
    one = variants(loop)[name]
    inputs = sequence(one, seed, samples=20000)
    expected, source = reference(one, inputs), c_controller(one)
    double = compiled(cc, source, tmp_path, *STRICT)(inputs)
    assert np.abs(double[:, :2] - expected[:, :2]).max() <= DOUBLE
    assert (double[:, 2:] == expected[:, 2:]).all()
    single = compiled(cc, source, tmp_path, *STRICT, *FLOAT)(inputs)
    assert np.abs(single[:, 0] - expected[:, 0]).max() <= SINGLE


@pytest.mark.consumer
@pytest.mark.parametrize(
    "options", [["-std=c90"], ["-std=c99"], ["-std=c11"], ["-std=c90", *FLOAT], ["-x", "c++"], ["-x", "c++", *FLOAT]]
)
def test_the_export_compiles_without_a_warning(consumer, constant_load_file, tmp_path, options):
    cc = consumer("c++" if "c++" in options else "cc", "apt-get install g++" if "c++" in options else INSTALL)
    for average in ({}, {"average": 3, "filter_time": 0.0}):
        (tmp_path / "controller.c").write_text(rendered(constant_load_file(pi=average), "c"))
        (tmp_path / "driver.c").write_text(DRIVER)
        (tmp_path / "other.c").write_text('#define LOAD_CONTROL_DECLARATIONS_ONLY\n#include "controller.c"\n')
        for source in ("driver.c", "other.c"):
            made = [cc, *options, *STRICT, "-O2", "-c", source, "-o", "out.o"]
            subprocess.run(made, cwd=tmp_path, check=True)
