"""Correctors by name, as the command line, scenarios and the evaluation use them.

Another distribution adds a corrector through the entry-point group `voxdepth.correctors`, whose entries map a name to a
`factory(intrinsics)`. The factory may have an attribute `latency_s`, see the function of that name. Its code is loaded
when its name is used, and it cannot replace a corrector of this library. Without a distribution a corrector is named
by its code, as `module:factory`.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from .errors import ConfigError, no_such
from .types import DepthCorrector, Intrinsics

if TYPE_CHECKING:
    from .paper.config import VoxDepthConfig
    from .temporal.config import TemporalConfig

ENTRY_POINTS = "voxdepth.correctors"
"""Group of the entry points by which other distributions add correctors."""
DEFAULT, PAPER, AUTHORS = "temporal", "voxdepth", "voxdepth-authors"
"""The corrector that is used unless another is named, the method of the paper, and that as its authors' code has it."""
METHODS_OF_THE_PAPER = (PAPER, AUTHORS)
TITLES = {PAPER: ("VoxDepth", " (the paper)"), DEFAULT: ("temporal", " (ours)")}
"""The name and the origin of the two methods of this library that are no baselines, as people read them."""


@dataclass(frozen=True)
class Entry:
    """A corrector of this library. It is imported when it is created, so that the registry alone is light."""

    path: str
    """The class as `module:name`; it takes the intrinsics, and the configuration if it has one."""
    latency_s: float
    config: str | None = None
    """What makes its default configuration, as `module:name`; None for a corrector without one."""
    needs: str | None = None
    """A module that an extra of this library installs; None for a corrector that needs none."""


def _imported(path: str) -> Any:
    """Import `module:name` of this library."""
    module, name = path.split(":")
    return getattr(import_module(f".{module}", __package__), name)


_REGISTRY = {
    "raw": Entry("baselines.single_frame:Raw", 0.0),
    "median": Entry("baselines.single_frame:Median", 0.0002),
    "realsense-left": Entry("baselines.realsense:RealSenseLeft", 0.0007),
    "realsense": Entry("baselines.realsense:RealSenseChain", 0.0035),
    "lmeds": Entry("baselines.lmeds:LMedS", 0.0161),
    "ip-basic": Entry("baselines.ip_basic:IpBasic", 0.0013),
    "telea": Entry("baselines.single_frame:Telea", 0.0075),
    "navier-stokes": Entry("baselines.single_frame:NavierStokes", 0.0035),
    "global-smoother": Entry("baselines.global_smoother:GlobalSmoother", 0.0064),
    "learned": Entry("baselines.learned:Learned", 0.0113, needs="onnxruntime"),
    PAPER: Entry("paper.method:VoxDepth", 0.0034, config="paper.config:VoxDepthConfig"),
    AUTHORS: Entry("paper.method:VoxDepth", 0.0034, config="paper.config:authors_config"),
    DEFAULT: Entry("temporal.method:TemporalCorrector", 0.0087, config="temporal.config:TemporalConfig"),
}

BUILTIN_NAMES = tuple(_REGISTRY)
"""The correctors of this library."""


def corrector_names() -> tuple[str, ...]:
    """Return the correctors of this library and those of other distributions, which are not loaded for that."""
    others = {entry.name for entry in entry_points(group=ENTRY_POINTS)}
    return (*BUILTIN_NAMES, *sorted(others.difference(BUILTIN_NAMES)))


def installed_names() -> tuple[str, ...]:
    """Return the correctors of this library but those that need an extra that is not installed."""
    return tuple(name for name, entry in _REGISTRY.items() if entry.needs is None or find_spec(entry.needs))


def title(text: str) -> str:
    """Return a corrector, perhaps with settings behind its name, as people read it: `VoxDepth (the paper)`."""
    name = text.partition("[")[0]
    shown, origin = TITLES.get(name, (name, ""))
    return text.replace(name, shown, 1) + origin


def require_known(name: str) -> None:
    """Raise a `ConfigError` if no corrector has that name. Only `module:factory` is loaded."""
    if name in BUILTIN_NAMES:
        return
    if ":" in name:
        _load(name)
    elif name not in (names := corrector_names()):
        raise ConfigError(f"{no_such('corrector', name, names)}, or name your own as module:factory")


def config_of(name: str) -> "TemporalConfig | VoxDepthConfig | None":
    """Return the default configuration of a known corrector; None for a corrector without one."""
    require_known(name)
    entry = _REGISTRY.get(name)
    if entry is None or entry.config is None:
        return None
    default: TemporalConfig | VoxDepthConfig = _imported(entry.config)()
    return default


def resolve_config(name: str, given: Mapping[str, Any]) -> "TemporalConfig | VoxDepthConfig":
    """Return the configuration of a corrector with the given values over its defaults.

    Raises:
        ConfigError: The corrector takes no configuration, or a key or a value is wrong.
    """
    from .model import changed, explained

    default = config_of(name)
    if default is None:
        raise _takes_no_config(name)
    merged, where = changed(default.model_dump(mode="json"), given), f"config of the corrector {name!r}"
    try:  # As JSON, in which a list may stand for a tuple and a string for an enumeration.
        with explained(
            type(default), lambda problem: ConfigError(f"{where}: {problem}; `voxdepth config {name}` prints all")
        ):
            return type(default).model_validate_json(json.dumps(merged))
    except TypeError as error:  # TOML has dates and times, JSON has not.
        raise ConfigError(f"{where}: {error}; give numbers, texts and lists") from error


def create_corrector(
    name: str, intrinsics: Intrinsics, config: "TemporalConfig | VoxDepthConfig | Mapping[str, Any] | None" = None
) -> DepthCorrector:
    """Create the corrector of that name, one of `corrector_names()`, for one camera.

    A configuration is of the corrector's own type, or the values that differ from its default, see `resolve_config`.

    The confidence of a corrector of this library is the probability that a depth is right. `temporal` has its
    own; that of the others is fitted to their default configuration, and the same with any other, see `calibration`.

    Raises:
        ConfigError: See `create_bare`.
    """
    from .calibration import calibrated

    return calibrated(create_bare(name, intrinsics, config), name)


def create_bare(
    name: str, intrinsics: Intrinsics, config: "TemporalConfig | VoxDepthConfig | Mapping[str, Any] | None" = None
) -> DepthCorrector:
    """Create a corrector as `create_corrector` does, but with the confidence of the method itself.

    Raises:
        ConfigError: The name is unknown, the corrector takes no configuration or another one, it needs a camera with a
            baseline or an extra that is not installed, or it belongs to another distribution and cannot be loaded.
    """
    default = config_of(name)
    if config is not None and default is None:
        raise _takes_no_config(name)
    if name not in _REGISTRY:
        from .plugins import PluginCorrector

        return PluginCorrector(code_of(name) or name, _load(name), intrinsics)
    entry = _REGISTRY[name]
    resolved = resolve_config(name, config) if isinstance(config, Mapping) else config or default
    corrector: DepthCorrector = _imported(entry.path)(intrinsics, *(() if resolved is None else (resolved,)))
    return corrector


def latency_s(name: str) -> float:
    """Return the simulated time that a corrector takes for a frame [s].

    That of a corrector of this library is its median time per frame at 160 x 120 pixels on one core, rounded. It is a
    constant, so that results of simulations do not depend on the machine.

    Raises:
        ConfigError: The name is unknown, or the factory of another distribution has no attribute `latency_s`.
    """
    require_known(name)
    if name in _REGISTRY:
        return _REGISTRY[name].latency_s
    latency = getattr(_load(name), "latency_s", None)
    if latency is None:
        raise ConfigError(
            f"the corrector {name!r} has no latency, the simulated seconds that a frame takes: give its class the line "
            f"latency_s = 0.01, or the scenario the line corrector_latency_s = {{ {name!r} = 0.01 }}"
        )
    return float(latency)


def code_of(name: str) -> str | None:
    """Return the code of a corrector as `module:factory`; None for one of this library."""
    if name in _REGISTRY:
        return None
    return name if ":" in name else next(iter(entry_points(group=ENTRY_POINTS, name=name))).value


def _takes_no_config(name: str) -> ConfigError:
    configurable = ", ".join(other for other, entry in _REGISTRY.items() if entry.config is not None)
    return ConfigError(f"the corrector {name!r} takes no configuration; leave it out, or choose one of: {configurable}")


def _load(name: str) -> Callable[[Intrinsics], DepthCorrector]:
    """Load a factory that is none of ours."""
    from .plugins import CORRECTOR, load

    return load("corrector", name, CORRECTOR, None if ":" in name else code_of(name))
