"""What an operating system lacks: libraries that packages load, with what brings them, memory, threads and space."""

import errno
import os
import re

MISSING = re.compile(r"\b(?P<name>lib[\w.+-]+?)\.so\.(?P<version>\d+)[\d.]*: cannot open shared object file")
"""How the loader of Linux names a library that it does not find."""
OF_A_WHEEL = re.compile(r"-[0-9a-f]{8}$")
"""End of the name of a library that a wheel brings itself."""
PACKAGES = {"libglib-2.0": "libglib2.0-0", "libgthread-2.0": "libglib2.0-0", "libGLdispatch": "libglvnd0"}
"""Packages of Debian that are not named after their library."""


def _numbers(*names: str) -> tuple[int, ...]:
    """Return the numbers of errors, of those that the system has."""
    return tuple(getattr(errno, name) for name in names if hasattr(errno, name))


FULL = _numbers("ENOSPC", "EDQUOT", "EFBIG")
"""Errors of a disk, a quota or a limit that is full."""
SCARCE = _numbers("ENOMEM", "EAGAIN", "EMFILE", "ENFILE")
"""Errors of memory, processes and open files."""
SCARCE_TEXT = re.compile("can't start new thread|failed to map segment|annot allocate memory|nsufficient memory")
"""How Python, the loader of Linux and OpenCV say that there is no more."""


def exhausted(error: BaseException) -> str | None:
    """Return what to do where the system has no more space, memory, threads or files; None if an error says else."""
    number = error.errno if isinstance(error, OSError) else None
    if number in FULL:
        return f"cannot write: {os.strerror(number)}; make space and repeat the command"
    if isinstance(error, MemoryError) or number in SCARCE or SCARCE_TEXT.search(str(error)):
        reason = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(": ")
        return (
            f"this needs more memory, threads or open files ({reason}): end other programs, or raise the limits "
            "(ulimit)"
        )
    return None


def missing_library(error: BaseException | None) -> str | None:
    """Return what a user has to install where an error, or one that caused it, names a missing library of the system.

    None if there is none: packages of Python bring the others themselves.
    """
    while error is not None:
        found = MISSING.search(str(error))
        if found is not None and not OF_A_WHEEL.search(found["name"]):
            library = f"{found['name']}.so.{found['version']}"
            return (
                f"the system lacks the library {library}: install the package of your system that has it, on Debian "
                f"and Ubuntu apt install {_package(found['name'], found['version'])}"
            )
        error = error.__cause__
    return None


def _package(library: str, version: str) -> str:
    """Return Debian's package that has a library, named by its policy from the name of the library."""
    separator = "-" if library[-1].isdigit() else ""
    return PACKAGES.get(library, f"{library}{separator}{version}".lower())
