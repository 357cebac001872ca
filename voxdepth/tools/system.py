"""Libraries of the operating system that packages load: which one is missing, and what brings it."""

import re

MISSING = re.compile(r"\b(?P<name>lib[\w.+-]+?)\.so\.(?P<version>\d+)[\d.]*: cannot open shared object file")
"""How the loader of Linux names a library that it does not find."""
OF_A_WHEEL = re.compile(r"-[0-9a-f]{8}$")
"""End of the name of a library that a wheel brings itself."""
PACKAGES = {"libglib-2.0": "libglib2.0-0", "libgthread-2.0": "libglib2.0-0", "libGLdispatch": "libglvnd0"}
"""Packages of Debian that are not named after their library."""


def lacking(error: BaseException | None) -> str | None:
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
    """The package of Debian that has a library, whose name follows from that of the library by the policy of Debian."""
    separator = "-" if library[-1].isdigit() else ""
    return PACKAGES.get(library, f"{library}{separator}{version}".lower())
