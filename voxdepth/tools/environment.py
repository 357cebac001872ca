"""The environment in which a command runs: what it writes depends on its arguments, its files and the seed alone.

Libraries read variables and files of their own, which their user may have set for other programs. Call `settle` before
one of them is imported; processes that are started later inherit the result. Files that nothing can keep a library from
reading are refused by `configured` if it fails on them.
"""

import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import ToolError

IGNORED = (
    "DASK_",
    "GIT_COMMON_DIR", "GIT_DIR", "GIT_INDEX_FILE", "GIT_WORK_TREE",
    "MATPLOTLIBRC", "MPLBACKEND",
    "NPY_PROMOTION_STATE",
    "NUMBA_",
    "OPENCV_",
    "OTEL_", "TELEMETRY_",
    "PANDAS_",
    "PYTHONWARNINGS",
    "RERUN", "_RERUN",
    "TOKIO_",
)  # fmt: skip
"""Beginnings of the names of variables that could change what is written, or end a command with a foreign error."""
KEPT = ("NUMBA_BOUNDSCHECK", "NUMBA_CACHE_DIR", "NUMBA_CPU_FEATURES", "NUMBA_CPU_NAME", "OPENCV_CPU_DISABLE")
"""Variables that say where compiled code is kept, what it checks, and for which processor it is."""
NUMBERS = ("NUMBA_BOUNDSCHECK",)
"""Those that must be integers: of others, Numba prints a traceback and goes on without."""
SET = {"MATPLOTLIBRC": os.devnull, "PYTHONSAFEPATH": "1"}
"""Variables in the place of a configuration file of the home, and of the option -P of the Python of new processes: a
script of the current folder replaces no package there."""
REFUSED = ".numba_config.yaml"
"""File of the current folder by which Numba would compile otherwise, or not at all; nothing else names another one."""
RUST_LOG = "warn,re_log_encoding=off,re_sdk::recording_stream=off"
"""What Rerun prints by itself: not that a file cannot be written, which is an error of ours."""


def settle() -> None:
    """Remove the variables of libraries that change results, set those that guard them, and let no warning be an error.

    A variable that chooses what is only printed stays as the user set it.

    Raises:
        ToolError: The current folder cannot be used, or has a file that configures Numba, or a variable is no number.
    """
    for name in [name for name in os.environ if name.startswith(IGNORED) and name not in KEPT]:
        del os.environ[name]
    os.environ.update(SET)
    os.environ.setdefault("RUST_LOG", RUST_LOG)
    for name in NUMBERS:
        if not (value := os.environ.get(name, "0")).isdecimal():
            raise ToolError(f"the variable {name} must be 0 or 1, got {value!r}: correct or unset it")
    if sys.warnoptions:
        sys.warnoptions.clear()  # New processes would get them.
        warnings.resetwarnings()
        for category in (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning):
            warnings.simplefilter("ignore", category)  # As in Python without options.
    warnings.simplefilter("ignore", EncodingWarning)  # That of libraries, with PYTHONWARNDEFAULTENCODING.
    _require_usable_folder()


@contextmanager
def configured(library: str, files: str) -> Iterator[None]:
    """Refuse configuration files of a library that fails on them while the block imports it.

    Args:
        library: Its name.
        files: Where they may lie.

    Raises:
        ToolError: It failed, other than by a part of it that is not installed.
    """
    try:
        yield
    except (ValueError, TypeError, AttributeError, OSError) as error:
        reason = " ".join(str(error).split())
        raise ToolError(
            f"{library} does not load with its configuration ({type(error).__name__}: {reason}): mend or move {files}"
        ) from error


def _require_usable_folder() -> None:
    """Raise a `ToolError` if the current folder is gone, closed, or configures Numba."""
    try:
        here = Path.cwd()
        is_configured = (here / REFUSED).exists()
    except FileNotFoundError as error:
        raise ToolError("the current folder was deleted: change to another one") from error
    except PermissionError as error:
        raise ToolError("the current folder may not be looked into: change to another one") from error
    if is_configured:
        raise ToolError(f"{REFUSED} in the current folder configures Numba for something else: use another folder")
