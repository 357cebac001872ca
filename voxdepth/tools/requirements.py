"""What the library and its extras require, by the metadata of the installation."""

import re
from collections import Counter
from importlib.metadata import requires
from importlib.util import find_spec
from typing import NamedTuple

from packaging import requirements as packaging
from packaging.specifiers import SpecifierSet
from packaging.version import InvalidVersion

EXTRA = re.compile(r"""(?: and )?extra == ["'](\w+)["']""")


class Requirement(NamedTuple):
    """A required distribution."""

    name: str
    extra: str | None
    """The extra that requires it; None for the library itself."""
    where: str
    """The environments that it is required in, as an environment marker; empty for all."""
    allowed: SpecifierSet = SpecifierSet()
    """Its versions that are allowed."""

    def allows(self, version: str) -> bool:
        """Return whether a version is allowed; one before a release is allowed if the release is."""
        try:
            return self.allowed.contains(version, prereleases=True)
        except InvalidVersion:
            return False

    @property
    def remedy(self) -> str:
        """The command that installs it."""
        command = "pip install voxdepth" if self.extra is None else f"pip install 'voxdepth[{self.extra}]'"
        return f"{command}, where {self.where}" if self.where else command


def requirements() -> list[Requirement]:
    """Return all that is required beside the library itself; a `PackageNotFoundError` where that is not installed."""
    found = []
    for each in map(packaging.Requirement, requires("voxdepth") or ()):
        marker = str(each.marker or "")
        extra = EXTRA.search(marker)
        if each.name != "voxdepth":
            where = EXTRA.sub("", marker).strip(" ()")
            found.append(Requirement(each.name, extra and extra[1], where, each.specifier))
    return found


def bringing(module: str) -> Requirement | None:
    """Return what brings a module: of several extras that require it, the smallest; None if none does."""
    required = [each for each in requirements() if each.extra is not None]
    sizes = Counter(each.extra for each in required)
    able = [each for each in required if first_word(each.name) == module]
    return min(able, key=lambda each: sizes[each.extra], default=None)


def missing(module: str) -> str | None:
    """Return what installs the package of a module that cannot be imported; None if it is there without the module."""
    package = module.partition(".")[0]
    if (found := bringing(package)) is not None:
        return f"this needs the package {found.name}: {found.remedy}"
    if find_spec(package) is None:  # What the library or one of the others requires; a defect of ours has a package.
        return f"this needs the package {package}, which is not installed: repeat the installation of voxdepth"
    return None


def first_word(name: str) -> str:
    """Return what the module of a distribution is called, if not after all of its name: rerun of rerun-sdk."""
    return name.lower().split("-")[0]
