"""The methods that are compared: correctors by name, and an oracle that exists only here."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ...corrector_spec import CorrectorFactory, parse_corrector
from ...registry import (
    AUTHORS,
    CORRECTOR_NAMES,
    DEFAULT,
    PAPER,
    config_of,
    create_corrector,
    installed_names,
    resolve_config,
)
from ...types import DepthCorrector, Intrinsics
from ..errors import ToolError

ORACLE = "true-pose"
"""Splats the last frames by their TRUE poses: an upper bound of what memory can achieve, and not a corrector."""
DEFAULT_FILLED = f"{DEFAULT}[fill=all]"
"""The default method, but with a depth at every pixel, for comparisons that need one."""
METHOD_NAMES = (*installed_names(), DEFAULT_FILLED, ORACLE)
"""All methods that are compared by default: those that need no extra, and those whose extra is installed."""
WARM_UP_FRAMES = 3
"""Warm-up of a method without a configuration."""


@dataclass(frozen=True, kw_only=True)
class Method:
    """A corrector that can be made for any camera."""

    name: str
    make: CorrectorFactory
    sees_true_pose: bool = False
    """Whether it is an oracle that is given the true pose of every frame."""
    config: dict[str, Any] | None = None
    """Resolved configuration; None for a method that has none."""
    is_foreign: bool = False
    """Whether its code may change while every version stays the same, so that its results are never reused."""
    warm_up_frames: int = WARM_UP_FRAMES
    """Frames that another instance processes before the measurement, so that every stage has run once."""


def is_baseline(name: str) -> bool:
    """Whether a method is neither the default method nor the paper's, with any setting, nor the oracle."""
    return name.partition("[")[0] not in (DEFAULT, PAPER, AUTHORS, ORACLE)


def find_methods(names: Sequence[str]) -> list[Method]:
    """Find methods by name, see `find_method`; a name that is given twice is a `ToolError`."""
    for name in names:
        if names.count(name) > 1:
            raise ToolError(f"--methods names {name!r} twice: once is enough")
    return [find_method(name) for name in names]


def find_method(name: str) -> Method:
    """Find a method; a name or a setting that does not exist is a `ConfigError` or a `ToolError`.

    It is the name of a corrector, perhaps with one setting of its configuration as in
    `temporal[fill=all]`, or your own corrector as `package.module:factory`.
    """
    if name == ORACLE:
        return Method(name=name, make=_oracle, sees_true_pose=True)
    corrector, setting = parse_corrector(name)
    config = resolve_config(corrector, setting) if setting else config_of(corrector)
    return Method(
        name=name,
        make=lambda intrinsics: create_corrector(corrector, intrinsics, config),
        config=None if config is None else config.model_dump(mode="json"),
        is_foreign=corrector not in CORRECTOR_NAMES,
        warm_up_frames=WARM_UP_FRAMES if config is None else config.warm_up_frames,
    )


def _oracle(intrinsics: Intrinsics) -> DepthCorrector:
    from ...baselines.pose_splat import PoseSplat

    return PoseSplat(intrinsics)
