"""One BLAS thread for the many small matrices of a fit.

Threads that share a matrix of some hundred rows cost more than they bring, and where other work wants the same cores
they wait for each other: a fit of seconds was seen to take minutes.
"""

from collections.abc import Callable
from functools import cache, wraps
from typing import ParamSpec, TypeVar

import scipy.linalg  # noqa: F401  its BLAS is loaded, and NumPy's, before libraries are looked for
from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
R = TypeVar("R")


def one_blas_thread(function: Callable[P, R]) -> Callable[P, R]:
    """The same function, with BLAS on one thread while it runs; the limit is the whole process's."""

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        """Call the function with one thread of BLAS."""
        with _libraries().limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited


@cache
def _libraries() -> ThreadpoolController:
    """Those of the process, looked for once: NumPy's and SciPy's."""
    return ThreadpoolController()
