"""What is compared: correctors by name, and one oracle that exists only here."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from voxdepth.registry import CORRECTOR_NAMES, config_of, require_known
from voxdepth.types import DepthCorrector, Intrinsics

from ..errors import ScenarioError
from ..regression import CorrectorFactory, find_corrector

ORACLE = "true-pose"
"""The splat of the last frames by the TRUE pose: an upper bound for what memory can give, and no corrector."""
METHOD_NAMES = (*CORRECTOR_NAMES, ORACLE)
"""All methods that are compared unless some are named."""
WARM_UP_FRAMES = 3
"""Frames that a method without a configuration works on before the clock starts."""


@dataclass(frozen=True, kw_only=True)
class Method:
    """A corrector that can be made for any camera."""

    name: str
    make: CorrectorFactory
    sees_true_pose: bool = False
    """Whether it is an oracle that is told the true pose of every frame."""
    config: dict[str, Any] | None = None
    """Resolved configuration; None for one that has none."""
    is_foreign: bool = False
    """Whether its code is not ours: it may change while every version stays, so its results are never reused."""
    warm_up_frames: int = WARM_UP_FRAMES
    """Frames that another instance works on before the clock starts, so that every stage has run once."""


def find_methods(names: Sequence[str]) -> list[Method]:
    """Methods by name; `package.module:factory` is one of your own.

    Raises:
        ConfigError, ScenarioError: There is none of that name, or one is named twice.
    """
    for name in names:
        if names.count(name) > 1:
            raise ScenarioError(f"--methods names {name!r} twice: once is enough")
    return [find_method(name) for name in names]


def find_method(name: str) -> Method:
    """One method by name.

    Raises:
        ConfigError, ScenarioError: There is none of that name.
    """
    if name == ORACLE:
        return Method(name=name, make=_oracle, sees_true_pose=True)
    if ":" in name:
        return Method(name=name, make=find_corrector(name), is_foreign=True)
    require_known(name)
    config = config_of(name)
    return Method(
        name=name,
        make=_registered(name),
        config=None if config is None else config.model_dump(mode="json"),
        is_foreign=name not in CORRECTOR_NAMES,
        warm_up_frames=WARM_UP_FRAMES if config is None else config.warm_up_frames,
    )


def _registered(name: str) -> CorrectorFactory:
    from voxdepth.registry import create_corrector

    return lambda intrinsics: create_corrector(name, intrinsics)


def _oracle(intrinsics: Intrinsics) -> DepthCorrector:
    from voxdepth.baselines.pose_splat import PoseSplat

    return PoseSplat(intrinsics)
