"""Numerical libraries on one thread."""

import os


def use_one_thread() -> None:
    """Keep numerical libraries on one thread, here if they are not imported yet, and in processes that start later.

    A variable that the user set stays. OpenCV and the renderer have settings of their own.
    """
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
