"""Correctors by name: the one vocabulary of the command line, scenarios and evaluation."""

from collections.abc import Callable

from .errors import ConfigError
from .types import DepthCorrector, Intrinsics


def _raw(intrinsics: Intrinsics) -> DepthCorrector:
    from .peers.raw import Raw

    return Raw()


def _paper(intrinsics: Intrinsics) -> DepthCorrector:
    from .config import VoxDepthConfig
    from .corrector import VoxDepth

    return VoxDepth(intrinsics, VoxDepthConfig.paper())


_FACTORIES: dict[str, Callable[[Intrinsics], DepthCorrector]] = {"raw": _raw, "paper": _paper}

CORRECTOR_NAMES = tuple(_FACTORIES)


def create_corrector(name: str, intrinsics: Intrinsics) -> DepthCorrector:
    """A new corrector of that name for one camera.

    Raises:
        ConfigError: No corrector has that name.
    """
    if name not in _FACTORIES:
        raise ConfigError(f"there is no corrector {name!r}; choose one of: {', '.join(CORRECTOR_NAMES)}")
    return _FACTORIES[name](intrinsics)
