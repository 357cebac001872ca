"""Correctors by name: the one vocabulary of the command line, scenarios and evaluation.

Another distribution adds one through the entry-point group `voxdepth.correctors`, whose entries map a name to a
`factory(intrinsics)`. It is loaded when its name is asked for, and never instead of one of ours.
"""

from collections.abc import Callable
from importlib.metadata import entry_points
from typing import TYPE_CHECKING

from .errors import ConfigError
from .types import DepthCorrector, Intrinsics

if TYPE_CHECKING:
    from .baselines.realsense_holes import HoleFillName
    from .config import VoxDepthConfig
    from .paper.config import PaperConfig

__all__ = [
    "CORRECTOR_NAMES",
    "DEFAULT",
    "ENTRY_POINTS",
    "config_of",
    "corrector_names",
    "create_corrector",
    "require_known",
]

ENTRY_POINTS = "voxdepth.correctors"
"""Group of the entry points by which other distributions add correctors."""


Factory = Callable[[Intrinsics], DepthCorrector]


def _raw(intrinsics: Intrinsics) -> DepthCorrector:
    from .baselines.raw import Raw

    return Raw()


def _median(intrinsics: Intrinsics) -> DepthCorrector:
    from .baselines.median import Median

    return Median()


def _realsense_holes(fill: "HoleFillName") -> Factory:
    def make(intrinsics: Intrinsics) -> DepthCorrector:
        from .baselines.realsense_holes import RealSenseHoles

        return RealSenseHoles(fill=fill)

    return make


def _realsense(intrinsics: Intrinsics) -> DepthCorrector:
    from .baselines.realsense_chain import RealSenseChain

    return RealSenseChain(intrinsics)


def _realsense_authors(intrinsics: Intrinsics) -> DepthCorrector:
    from .baselines.authors_max import AuthorsMax

    return AuthorsMax()


def _lmeds(intrinsics: Intrinsics) -> DepthCorrector:
    from .baselines.lmeds import LMedS

    return LMedS(intrinsics)


def _flow(intrinsics: Intrinsics) -> DepthCorrector:
    from .baselines.optical_flow import FlowFilter

    return FlowFilter(intrinsics)


def _ip_basic(intrinsics: Intrinsics) -> DepthCorrector:
    from .baselines.ip_basic import IpBasic

    return IpBasic(intrinsics)


def _ip_basic_multiscale(intrinsics: Intrinsics) -> DepthCorrector:
    from .baselines.ip_basic import IpBasic, Multiscale

    return IpBasic(intrinsics, completion=Multiscale())


def _telea(intrinsics: Intrinsics) -> DepthCorrector:
    from .baselines.opencv_inpaint import OpenCvInpaint

    return OpenCvInpaint(intrinsics, method="telea")


def _navier_stokes(intrinsics: Intrinsics) -> DepthCorrector:
    from .baselines.opencv_inpaint import OpenCvInpaint

    return OpenCvInpaint(intrinsics, method="navier_stokes")


def _global_smoother(intrinsics: Intrinsics) -> DepthCorrector:
    from .baselines.global_smoother import GlobalSmoother

    return GlobalSmoother(intrinsics)


_PEERS: dict[str, Factory] = {
    "raw": _raw,
    "median": _median,
    "realsense-left": _realsense_holes("left"),
    "realsense-farthest": _realsense_holes("farthest"),
    "realsense-nearest": _realsense_holes("nearest"),
    "realsense": _realsense,
    "realsense-authors": _realsense_authors,
    "lmeds": _lmeds,
    "flow": _flow,
    "ip-basic": _ip_basic,
    "ip-basic-multiscale": _ip_basic_multiscale,
    "telea": _telea,
    "navier-stokes": _navier_stokes,
    "global-smoother": _global_smoother,
}


def _default_config() -> "VoxDepthConfig":
    from .config import VoxDepthConfig

    return VoxDepthConfig()


def _paper_config() -> "PaperConfig":
    from .config import VoxDepthConfig

    return VoxDepthConfig.paper()


DEFAULT, PAPER = "voxdepth", "paper"
"""The two methods of `VoxDepth`: the one that is used unless another is named, and the paper's."""

_CONFIGS: "dict[str, Callable[[], VoxDepthConfig | PaperConfig]]" = {PAPER: _paper_config, DEFAULT: _default_config}
"""The correctors that take a configuration, with their own."""

CORRECTOR_NAMES = (*_PEERS, *_CONFIGS)
"""The correctors that come with this library."""


def corrector_names() -> tuple[str, ...]:
    """Ours and those that other distributions offer, which are not loaded for that."""
    others = {entry.name for entry in entry_points(group=ENTRY_POINTS)}
    return (*CORRECTOR_NAMES, *sorted(others.difference(CORRECTOR_NAMES)))


def config_of(name: str) -> "VoxDepthConfig | PaperConfig | None":
    """The configuration that belongs to the name of a corrector; None for one that has none.

    Raises:
        ConfigError: No corrector has that name.
    """
    require_known(name)
    return _CONFIGS[name]() if name in _CONFIGS else None


def create_corrector(
    name: str, intrinsics: Intrinsics, config: "VoxDepthConfig | PaperConfig | None" = None
) -> DepthCorrector:
    """A new corrector of that name for one camera.

    Args:
        name: One of `corrector_names()`.
        intrinsics: Of the camera.
        config: Instead of the one that belongs to the name, and of the same type.

    Raises:
        ConfigError: No corrector has that name, the one that has it takes no configuration or another one, or needs a
            camera with a baseline, or it is another distribution's and cannot be loaded.
    """
    own = config_of(name)
    if own is not None:
        return _configured(name, intrinsics, own, config)
    if config is not None:
        raise ConfigError(
            f"the corrector {name!r} takes no configuration; leave it out, or choose one of: {', '.join(_CONFIGS)}"
        )
    make = _PEERS[name] if name in _PEERS else _loaded(name)
    return make(intrinsics)


def _configured(
    name: str,
    intrinsics: Intrinsics,
    own: "VoxDepthConfig | PaperConfig",
    given: "VoxDepthConfig | PaperConfig | None",
) -> DepthCorrector:
    """The corrector with a configuration of its own type; with its own one if none is given."""
    from .corrector import VoxDepth

    config = own if given is None else given
    if type(config) is not type(own):
        raise ConfigError(
            f"the corrector {name!r} takes a {type(own).__name__}, got {type(config).__name__}; give one, or choose "
            "another corrector"
        )
    return VoxDepth(intrinsics, config)


def require_known(name: str) -> None:
    """Refuse a name that no corrector has; nothing is loaded.

    Raises:
        ConfigError: No corrector has that name.
    """
    if name not in CORRECTOR_NAMES and name not in corrector_names():
        raise ConfigError(f"there is no corrector {name!r}; choose one of: {', '.join(corrector_names())}")


def _loaded(name: str) -> Factory:
    """The factory of another distribution, after its code was loaded."""
    entry = next(iter(entry_points(group=ENTRY_POINTS, name=name)))
    try:
        factory: Factory = entry.load()
    except Exception as error:  # foreign code may raise anything
        raise ConfigError(
            f"the corrector {name!r} cannot be loaded from its entry point {entry.value!r} ({type(error).__name__}: "
            f"{error}); repair or uninstall the distribution that offers it"
        ) from error
    return factory
