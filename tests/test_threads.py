"""Number of BLAS threads of a process, by what threadpoolctl finds in its libraries."""

import os
import subprocess
import sys

import pytest

CODE = """
{before}
from fitmodels.core.threads import one_thread, start_with_one
start_with_one()
import numpy, scipy.linalg, sys

@one_thread
def inside():
    sought = "threadpoolctl" in sys.modules
    from threadpoolctl import threadpool_info
    return sought, {{one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}}

print(*inside())
"""


@pytest.mark.parametrize(
    ("before", "given", "sought"),
    [
        pytest.param("", {}, False, id="set before the libraries are loaded"),
        pytest.param("", {"OPENBLAS_NUM_THREADS": "2"}, True, id="a number of the user"),
        pytest.param("", {"BLIS_NUM_THREADS": "2"}, True, id="a number of another library"),
        pytest.param("", {"OPENBLAS_NUM_THREADS": ""}, True, id="an empty number"),
        pytest.param("import numpy", {}, True, id="loaded before"),
    ],
)
def test_one_thread_holds_and_is_limited_only_where_the_process_has_more(before, given, sought):
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")} | given
    run = [sys.executable, "-c", CODE.format(before=before)]
    found = subprocess.run(run, env=environment, capture_output=True, text=True, check=True).stdout.strip()
    assert found == f"{sought} {{1}}"
