"""Number of BLAS threads and of usable cores.

Matrices here are small: linear algebra on several threads costs up to ten times what it saves on a busy machine.
"""

import os
import sys
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import TYPE_CHECKING, ParamSpec, TypeVar

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]

P = ParamSpec("P")
R = TypeVar("R")
# Of the libraries that threadpoolctl can limit; BLIS prefers its own number to that of OpenMP.
ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS"), "1")
_process = {"has one": False}


def start_with_one() -> None:
    """Set one BLAS thread for this process and its children, where the environment has no number.

    It holds for libraries that are loaded afterwards; `one_thread` then has nothing to limit.
    """
    for name, number in ONE_THREAD.items():
        os.environ.setdefault(name, number)
    loaded = "numpy" in sys.modules
    _process["has one"] = not loaded and all(os.environ[name] == number for name, number in ONE_THREAD.items())


def one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Decorator: the function runs with one BLAS thread; the number of threads is restored afterwards.

    >>> @one_thread
    ... def doubled(x):
    ...     return 2 * x
    >>> doubled(2)
    4
    """

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        if _process["has one"]:
            return function(*args, **kwargs)
        import numpy.linalg  # noqa: F401  the libraries that are limited must be there
        import scipy.linalg  # noqa: F401

        with _controller("scipy.linalg" in sys.modules).limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited


def cores() -> int:
    """Number of cores that this process may use.

    >>> cores() >= 1
    True
    """
    if hasattr(os, "sched_getaffinity"):  # Linux: fewer than there are, under taskset or a batch system
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@lru_cache(maxsize=1)
def _controller(loaded: bool) -> "ThreadpoolController":  # another key, another look
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
