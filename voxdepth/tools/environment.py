"""The environment in which a command runs: what it writes depends on its arguments, its files and the seed alone.

Libraries read variables and files of their own, which their user may have set for other programs. Call `settle` before
one of them is imported; processes that are started later inherit the result.
"""

import os
import sys
import warnings
from pathlib import Path

from .errors import ToolError

IGNORED = (
    "GIT_COMMON_DIR", "GIT_DIR", "GIT_INDEX_FILE", "GIT_WORK_TREE",
    "MATPLOTLIBRC", "MPLBACKEND",
    "NPY_PROMOTION_STATE",
    "NUMBA_",
    "OPENCV_",
    "OTEL_", "TELEMETRY_",
    "PANDAS_",
    "PYTHONWARNINGS",
    "RERUN", "_RERUN",
)  # fmt: skip
"""Beginnings of the names of variables that could change what is written, or end a command with a foreign error."""
KEPT = ("NUMBA_BOUNDSCHECK", "NUMBA_CACHE_DIR", "NUMBA_CPU_FEATURES", "NUMBA_CPU_NAME", "OPENCV_CPU_DISABLE")
"""Variables that say where compiled code is kept, what it checks, and for which processor it is."""
SET = {"MATPLOTLIBRC": os.devnull}
"""Variables in the place of a configuration file of the home."""
REFUSED = ".numba_config.yaml"
"""File of the current folder by which Numba would compile otherwise, or not at all; nothing else names another one."""
RUST_LOG = "warn,re_log_encoding=off,re_sdk::recording_stream=off"
"""What Rerun prints by itself: not that a file cannot be written, which is an error of ours."""


def settle() -> None:
    """Remove the variables of libraries that change results, set those that guard them, and let no warning be an error.

    A variable that chooses what is only printed stays as the user set it.

    Raises:
        ToolError: The current folder is gone, or has a file that configures Numba.
    """
    for name in [name for name in os.environ if name.startswith(IGNORED) and name not in KEPT]:
        del os.environ[name]
    os.environ.update(SET)
    os.environ.setdefault("RUST_LOG", RUST_LOG)
    if sys.warnoptions:
        sys.warnoptions.clear()  # New processes would get them.
        warnings.resetwarnings()
        for category in (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning):
            warnings.simplefilter("ignore", category)  # As in Python without options.
    try:
        here = Path.cwd()
    except FileNotFoundError as error:
        raise ToolError("the current folder was deleted: change to another one") from error
    if (here / REFUSED).exists():
        raise ToolError(f"{REFUSED} in the current folder configures Numba for something else: use another folder")
