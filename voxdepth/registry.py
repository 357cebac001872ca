"""Correctors by name: the one vocabulary of the command line, scenarios and evaluation."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from .errors import ConfigError
from .types import DepthCorrector, Intrinsics

if TYPE_CHECKING:
    from .config import VoxDepthConfig

Factory = Callable[[Intrinsics, "VoxDepthConfig | None"], DepthCorrector]


def _raw(intrinsics: Intrinsics, config: "VoxDepthConfig | None") -> DepthCorrector:
    from .peers.raw import Raw

    if config is not None:
        raise ConfigError("the corrector 'raw' takes no configuration; leave it out, or choose 'paper'")
    return Raw()


def _paper(intrinsics: Intrinsics, config: "VoxDepthConfig | None") -> DepthCorrector:
    from .config import VoxDepthConfig
    from .corrector import VoxDepth

    return VoxDepth(intrinsics, config or VoxDepthConfig.paper())


_FACTORIES: dict[str, Factory] = {"raw": _raw, "paper": _paper}

CORRECTOR_NAMES = tuple(_FACTORIES)


def config_of(name: str) -> "VoxDepthConfig | None":
    """The configuration that belongs to the name of a corrector; None for one that has none.

    Raises:
        ConfigError: No corrector has that name.
    """
    from .config import VoxDepthConfig

    _require_known(name)
    return VoxDepthConfig.paper() if name == "paper" else None


def create_corrector(name: str, intrinsics: Intrinsics, config: "VoxDepthConfig | None" = None) -> DepthCorrector:
    """A new corrector of that name for one camera.

    Args:
        name: One of `CORRECTOR_NAMES`.
        intrinsics: Of the camera.
        config: Instead of the one that belongs to the name.

    Raises:
        ConfigError: No corrector has that name, or the one that has it takes no configuration.
    """
    _require_known(name)
    return _FACTORIES[name](intrinsics, config)


def _require_known(name: str) -> None:
    if name not in _FACTORIES:
        raise ConfigError(f"there is no corrector {name!r}; choose one of: {', '.join(CORRECTOR_NAMES)}")
