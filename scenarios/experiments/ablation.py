"""Ablation of the default method: one part off at a time, with its effect on errors and latency."""

from typing import Any

import pandas as pd

from voxdepth.registry import DEFAULT
from voxdepth.temporal.config import TemporalConfig
from voxdepth.tools.evaluation.methods import Method, find_method
from voxdepth.tools.evaluation.scoring import GHOSTS, SURVIVAL
from voxdepth.tools.figure import panels, plotted

from .default import FLICKER, HOLES, LATENCY, MEDIAN, OFF, PSNR_NEAR, RMSE, SEEN, Comparison
from .experiment import Experiment, ExperimentContext, Findings, configured_method

NEVER = 100_000
"""A threshold that nothing reaches."""
ANY = 1e-6
"""A threshold that everything passes."""
SEQUENCES = ("sim-LN", "sim-MB", "sim-PLF", "sim-cross", "sim-approach", "sim-hover")
"""Near and far surfaces, with and without parallax, and objects that move across and towards the camera."""
TOLD_POSE = "true-prior"
"""The variant that is told the true pose, as an oracle."""
VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
    DEFAULT: ("nothing", {}),
    "single-frame": (
        "neither tracking nor memory: inpainting and smoothing alone", {"odometry": {"min_tracks": NEVER}}
    ),
    "averaging-only": (
        "memory averages what it agrees with, and never fills holes or rejects measurements",
        {"fusion": {"min_evidence": 16, "min_evidence_per_frame": 16}},
    ),
    "memory-first": ("the memory outvotes all ends of holes", {"filling": {"memory_distance_px": ANY}}),
    "no-memory": ("the memory has no vote in holes", {"filling": {"memory_distance_px": NEVER}}),
    "no-previous": ("the previous output has no vote", {"filling": {"previous_distance_px": NEVER}}),
    "no-gray": ("changes of gray are ignored", {"fusion": {"max_gray_change_hole": 255}}),
    "no-drift": (
        "slow drift of measurements against the memory is ignored", {"fusion": {"max_drift_px": NEVER}}
    ),
    "no-bias": ("differences of one sign over 5 x 5 px still agree", {"fusion": {"max_bias_px": NEVER}}),
    "no-coherence": ("every pixel may contradict the memory by itself", {"fusion": {"min_coherence": ANY}}),
    "fast-decay": (
        "the background is forgotten as soon as an object occludes it", {"fusion": {"decay_occluded": 15}}
    ),
    "no-shadows": ("occlusion shadows have no bonus", {"filling": {"shadow_factor": 1}}),
    "no-rows": ("rows whose ends agree have no bonus", {"filling": {"row_factor": 1}}),
    "no-slopes": ("no surface is slanted", {"filling": {"max_slope": 0}}),
    "no-lone-ends": ("an axis with one end has no vote", {"filling": {"lone_factor": ANY}}),
    "no-fill": ("holes that the memory cannot fill stay empty", {"fill": "none"}),
    "fill-all": ("even the least probable guess is shown", {"fill": "all"}),
    "no-smoothing": ("no smoothing", {"smoothing_window_px": 1}),
    "full-size": ("memory at full size, not half", {"decimation": 1}),
    TOLD_POSE: ("told the true pose (an oracle)", {}),
}  # fmt: skip
"""The part that is off or different, and the changes of the configuration, by name."""


def config_of(variant: str) -> TemporalConfig:
    """The configuration of a variant."""
    return TemporalConfig.model_validate(VARIANTS[variant][1])


def method_of(variant: str) -> Method:
    """The method to evaluate; the unchanged variant shares its results with all other comparisons."""
    if variant == DEFAULT:
        return find_method(DEFAULT)
    return configured_method(DEFAULT, variant, config_of(variant), sees_true_pose=variant == TOLD_POSE)


def ablate(context: ExperimentContext) -> Findings:
    """Evaluate every variant on the same frames."""
    methods = {variant: method_of(variant) for variant in VARIANTS}
    comparison = Comparison(context.evaluate(list(methods.values())))
    found = pd.concat(
        {variant: quantities(comparison, method.name) for variant, method in methods.items()},
        names=["variant", "sequence"],
    )
    means = found.groupby("variant", sort=False).mean()
    off = pd.Series({variant: off for variant, (off, _) in VARIANTS.items()}, name="what is off")
    return Findings(
        tables={
            "table": pd.concat([off, means], axis=1).rename_axis("variant").reset_index(),
            "by-sequence": found.swaplevel().loc[list(context.sequences)].reset_index(),
        },
        notes=(
            f"Means over {', '.join(context.sequences)}. Surfaces within 20 m. Errors in holes and PSNR (peak 40 m) "
            "are after completion by the nearest valid; off is more than 10 % too far or too near. Survival and "
            "ghosts are of sequences with moving objects. Times are means of medians.",
            "One seed and a few sequences: a difference of a percent or two is not significant.",
        ),
        figure=panels(
            f"One part off, n = {context.frames} frames of {len(context.sequences)} sequences",
            [
                plotted(means[[heading]][::-1], "", heading, "", kind="barh")
                for heading in ("holes MAE [m]", "measured median [mm]")
            ],
        ),
    )


def quantities(comparison: Comparison, method: str) -> pd.DataFrame:
    """What is measured of a method (columns), by sequence."""
    values = {
        "holes MAE [m]": (HOLES, 1), "seen holes MAE [m]": (SEEN, 1), "holes off [%]": (OFF, 100),
        "measured RMSE [m]": (RMSE, 1), "measured median [mm]": (MEDIAN, 1000), "PSNR 20 m [dB]": (PSNR_NEAR, 1),
        "flicker [mm]": (FLICKER, 1000),
    }  # fmt: skip
    survival, ghosts = (
        100 * (comparison.values(own, method) - comparison.values(raw, method)) for own, raw in (SURVIVAL, GHOSTS)
    )
    return pd.DataFrame(
        {heading: factor * comparison.values(selector, method) for heading, (selector, factor) in values.items()}
        | {"survival less raw's [points]": survival, "ghosts less raw's [points]": ghosts}
        | {"p50 [ms]": comparison.values(LATENCY, method)}
    )


ABLATION = Experiment(
    "ablation", "What is each part of the default method worth, and what does it cost?",
    ablate, SEQUENCES, frames=30, min_frames=2,
)  # fmt: skip
