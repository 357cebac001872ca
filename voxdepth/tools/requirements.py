"""What the library and its extras require, by the metadata of the installation."""

import re
from collections import Counter
from importlib.metadata import requires
from typing import NamedTuple

EXTRA = re.compile(r"""(?: and )?extra == ["'](\w+)["']""")


class Requirement(NamedTuple):
    """A required distribution."""

    name: str
    extra: str | None
    """The extra that requires it; None for the library itself."""
    where: str
    """The environments that it is required in, as an environment marker; empty for all."""

    @property
    def remedy(self) -> str:
        """The command that installs it."""
        command = "pip install voxdepth" if self.extra is None else f"pip install 'voxdepth[{self.extra}]'"
        return f"{command}, where {self.where}" if self.where else command


def requirements() -> list[Requirement]:
    """Everything that is required beside the library itself; a `PackageNotFoundError` where that is not installed."""
    found = []
    for text in requires("voxdepth") or ():
        required, _, marker = text.partition(";")
        extra = EXTRA.search(marker)
        name = re.match(r"[\w.-]+", required)
        if name and name[0] != "voxdepth":
            found.append(Requirement(name[0], extra and extra[1], EXTRA.sub("", marker).strip(" ()")))
    return found


def bringing(module: str) -> Requirement | None:
    """Return what brings a module: of several extras that require it, the smallest; None if none does."""
    required = [each for each in requirements() if each.extra is not None]
    sizes = Counter(each.extra for each in required)
    able = [each for each in required if each.name.lower().split("-")[0] == module]
    return min(able, key=lambda each: sizes[each.extra], default=None)
