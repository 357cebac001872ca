"""The default method with one part off, each alone: what every part is worth, and what it costs."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from voxdepth.config import VoxDepthConfig
from voxdepth.registry import DEFAULT
from voxdepth.temporal.fusion import TemporalFusionConfig
from voxdepth.temporal.ground import GroundConfig
from voxdepth.temporal.inpainting import InpaintingConfig
from voxdepth.temporal.odometry import VisualOdometryConfig
from voxdepth.temporal.planes import PlanesConfig

from ..evaluation.groups import ALL
from ..evaluation.measurements import AS_GIVEN, FILLED, FRAMES
from ..evaluation.methods import Method, find_method
from ..evaluation.scoring import DEPARTED, MOVING
from .drawing import labelled, panels
from .result import Column, Result, Table, Value
from .stage import Scope, Stage
from .standing import HOLES, Reading, Standing, less, scaled, with_mean
from .variants import default_variant

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NEVER = 1e6
"""A threshold that nothing reaches."""
ANY = 1e-6
"""A threshold that everything passes."""
AS_IT_IS = VoxDepthConfig()
SEQUENCES = ("sim-LN", "sim-MB", "sim-PLF", "sim-cross", "sim-approach", "sim-hover")
"""Near and far, with parallax and without, and things that move across and towards the camera: what parts are for."""


@dataclass(frozen=True, kw_only=True)
class Variant:
    """The default method with another configuration."""

    name: str
    off: str
    """What is off, or what is different."""
    config: VoxDepthConfig = AS_IT_IS
    sees_true_pose: bool = False
    """Whether it is told the true pose, as an oracle."""

    @property
    def method(self) -> Method:
        """The method that is judged. As it is, it is the same as everywhere else, with the same results."""
        if self.name == DEFAULT:
            return find_method(DEFAULT)
        return default_variant(self.name, self.config, sees_true_pose=self.sees_true_pose)


def _fusion(name: str, off: str, **changes: float) -> Variant:
    return Variant(name=name, off=off, config=VoxDepthConfig(fusion=TemporalFusionConfig.model_validate(changes)))


VARIANTS = (
    Variant(name=DEFAULT, off="nothing"),
    Variant(
        name="single-frame",
        off="no pose is looked for, and nothing remembered: filling and smoothing alone",
        config=VoxDepthConfig(odometry=VisualOdometryConfig(min_tracks=int(NEVER))),
    ),
    _fusion("never-sure", "memory averages what it agrees with, and never fills or overrules", min_evidence=16),
    _fusion(
        "no-gray",
        "changes of gray say nothing",
        min_gray_change_free_space=0,
        min_gray_change_occluding=0,
        max_gray_change_hole=255,
    ),
    _fusion("no-drift", "slow drift of measurements against the memory does not count", max_drift_px=NEVER),
    _fusion("no-bias", "differences of one sign over 5 x 5 px still agree", max_bias_px=NEVER),
    _fusion("no-coherence", "every pixel may contradict the memory by itself", min_coherence=ANY),
    _fusion("no-patience", "a wall is forgotten as soon as something passes before it", decay_occluded=15),
    Variant(
        name="no-slope",
        off="holes are filled by values, not by planes",
        config=VoxDepthConfig(inpainting=InpaintingConfig(planes=PlanesConfig(ridge=NEVER))),
    ),
    Variant(
        name="no-ground",
        off="no ground is looked for, so nothing stands on it",
        config=VoxDepthConfig(inpainting=InpaintingConfig(ground=GroundConfig(min_inlier_ratio=NEVER))),
    ),
    Variant(
        name="no-shadows",
        off="occlusion shadows are filled like any hole",
        config=VoxDepthConfig(inpainting=InpaintingConfig(min_shadow_step_px=NEVER)),
    ),
    Variant(name="no-fill", off="holes that memory does not know stay empty", config=VoxDepthConfig(inpaint=False)),
    Variant(name="no-smoothing", off="no smoothing", config=VoxDepthConfig(smoothing_window_px=1)),
    Variant(name="full-size", off="memory at full size, not half", config=VoxDepthConfig(decimation=1)),
    Variant(name="true-prior", off="told the true pose (an oracle)", sees_true_pose=True),
)


@dataclass(frozen=True, kw_only=True)
class Shown:
    """One column: a figure in its unit; less another figure of the same cell, if one is named."""

    column: Column
    reading: Reading
    factor: float = 1.0
    less: Reading | None = None

    def of(self, at: Standing, method: str) -> float | None:
        """Of a method on a sequence."""
        value = at.value(self.reading, method)
        return scaled(value if self.less is None else less(value, at.value(self.less, method)), self.factor)


def _of_frames(metric: str) -> Reading:
    return Reading(metric=metric, mask=FRAMES, within=FRAMES, on=FRAMES)


def _survival(metric: str) -> Reading:
    return Reading(metric=metric, mask=MOVING, within=ALL, on=AS_GIVEN)


def _ghosts(metric: str) -> Reading:
    return Reading(metric=metric, mask=DEPARTED, within=ALL, on=FILLED)


SHOWN = (
    Shown(column=Column(name="holes MAE", unit="m", places=3), reading=HOLES),
    Shown(column=Column(name="seen holes MAE", unit="m", places=3), reading=Reading(metric="mae", mask="holes seen")),
    Shown(column=Column(name="holes off", unit="%", places=1), reading=Reading(metric="off", mask="holes"), factor=100),
    Shown(
        column=Column(name="measured RMSE", unit="m", places=3),
        reading=Reading(metric="rmse", mask="measured", on=FILLED),
    ),
    Shown(
        column=Column(name="measured median", unit="mm", places=1),
        reading=Reading(metric="median", mask="measured", on=FILLED),
        factor=1000,
    ),
    Shown(column=Column(name="PSNR 20 m", unit="dB"), reading=Reading(metric="psnr_40m")),
    Shown(
        column=Column(name="flicker", unit="mm", places=1),
        reading=Reading(metric="flicker", mask="static", on=FILLED),
        factor=1000,
    ),
    Shown(
        column=Column(name="survival less raw's", unit="points", places=1),
        reading=_survival("survival"),
        less=_survival("survival_raw"),
        factor=100,
    ),
    Shown(
        column=Column(name="ghosts less raw's", unit="points", places=1),
        reading=_ghosts("ghosts"),
        less=_ghosts("ghosts_raw"),
        factor=100,
    ),
    Shown(column=Column(name="p50", unit="ms", places=1), reading=_of_frames("latency_p50")),
    Shown(column=Column(name="p50", unit="workloads", places=1), reading=_of_frames("latency_p50_workloads")),
)


class Ablation:
    """Every variant on the same frames."""

    name = "ablation"
    question = "What is each part of the default method worth, and what does it cost?"
    scope = Scope(sequences=SEQUENCES, frames=30, least_frames=2)

    def run(self, stage: Stage) -> Result:
        """See `Experiment`."""
        methods = [variant.method for variant in VARIANTS]
        done = stage.judged(methods)
        standings = [Standing(done=done, sequence=name) for name in stage.sequences]
        columns = tuple(shown.column for shown in SHOWN)
        means = [(variant.name, variant.off, *_mean(standings, variant)) for variant in VARIANTS]
        each = [
            (at.sequence, variant.name, *(shown.of(at, variant.method.name) for shown in SHOWN))
            for at in standings
            for variant in VARIANTS
        ]
        titles = (Column(name="variant"), Column(name="what is off")), (Column(name="sequence"), Column(name="variant"))
        over = ", ".join(stage.sequences)
        return Result(
            tables=(
                Table.of(f"One part off, mean over {over}", (*titles[0], *columns), means),
                Table.of("By sequence", (*titles[1], *columns), each, "by-sequence"),
            ),
            notes=(
                "Surfaces within 20 m. Errors in holes and PSNR (peak 40 m) are after completion by the nearest valid; "
                "off is more than 10 % too far or too near. Survival and ghosts are of sequences where things move.",
                "Times are medians, and means of these over sequences of different sizes; the reference workload is a "
                "5x5 median of 640x360 pixels, timed between the frames.",
                "One seed and a few sequences: a difference of a percent or two says nothing.",
            ),
            figure=panels(
                f"One part off, n = {stage.frames} frames of {len(stage.sequences)} sequences",
                *(partial(_draw, standings, place) for place in (0, 4)),
            ),
        )


def _mean(standings: Sequence[Standing], variant: Variant) -> list[Value]:
    """Of every column, over the sequences that have it."""
    rows = [(at.sequence, *(shown.of(at, variant.method.name) for shown in SHOWN)) for at in standings]
    return list(with_mean(rows)[-1][1:])


def _draw(standings: Sequence[Standing], place: int, axes: "Axes") -> None:
    """A bar for each variant, upside down so that the first is on top."""
    values = [_mean(standings, variant)[place] for variant in VARIANTS]
    lengths = [value if isinstance(value, float) else 0.0 for value in values]
    axes.barh(range(len(VARIANTS)), lengths)
    axes.set_yticks(range(len(VARIANTS)), [variant.name for variant in VARIANTS], fontsize=7)
    axes.invert_yaxis()
    column = SHOWN[place].column
    labelled(axes, column.name, column.title, "")
