"""Ablation of the default method: one part off at a time, with its effect on errors and latency."""

import pandas as pd

from voxdepth.registry import DEFAULT
from voxdepth.tools.evaluation.scoring import GHOSTS, SURVIVAL
from voxdepth.tools.figure import panels, plotted

from .default import FLICKER, HOLES, LATENCY, MEDIAN, OFF, PSNR_NEAR, RMSE, SEEN
from .experiment import ExperimentContext, Findings, asks

NEVER, ANY = 100_000, 1e-6
"""Thresholds that nothing reaches, and that everything passes."""
SEQUENCES = ("sim-LN", "sim-MB", "sim-PLF", "sim-cross", "sim-approach", "sim-hover")
"""Near and far surfaces, with and without parallax, and objects that move across and towards the camera."""
SETTINGS = {
    f"odometry.min_tracks={NEVER}": "neither tracking nor memory: inpainting and smoothing alone",
    f"filling.memory_distance_px={ANY}": "the memory outvotes all ends of holes",
    f"filling.memory_distance_px={NEVER}": "the memory has no vote in holes",
    f"filling.previous_distance_px={NEVER}": "the previous output has no vote",
    "fusion.max_gray_change_hole=255": "changes of gray are ignored",
    f"fusion.max_drift_px={NEVER}": "slow drift of measurements against the memory is ignored",
    f"fusion.max_bias_px={NEVER}": "differences of one sign over 5 x 5 px still agree",
    f"fusion.min_coherence={ANY}": "every pixel may contradict the memory by itself",
    "fusion.decay_occluded=15": "the background is forgotten as soon as an object occludes it",
    "filling.shadow_factor=1": "occlusion shadows have no bonus",
    "filling.row_factor=1": "rows whose ends agree have no bonus",
    "filling.max_slope=0": "no surface is slanted",
    f"filling.lone_factor={ANY}": "an axis with one end has no vote",
    "fill=none": "holes that the memory cannot fill stay empty",
    "fill=all": "even the least probable guess is shown",
    "smoothing_window_px=1": "no smoothing",
    "decimation=1": "memory at full size, not half",
}
"""What a setting switches off or changes. `voxdepth evaluate --methods` takes the same names."""
QUANTITIES = {
    "holes MAE [m]": (HOLES, 1), "seen holes MAE [m]": (SEEN, 1), "holes off [%]": (OFF, 100),
    "measured RMSE [m]": (RMSE, 1), "measured median [mm]": (MEDIAN, 1000), "PSNR 20 m [dB]": (PSNR_NEAR, 1),
    "flicker [mm]": (FLICKER, 1000), "p50 [ms]": (LATENCY, 1),
}  # fmt: skip
"""What is measured of a variant, and the factor to the unit of its heading."""
VARIANTS = {DEFAULT: "nothing"} | {f"{DEFAULT}[{setting}]": off for setting, off in SETTINGS.items()}


@asks(
    "What is each part of the default method worth, and what does it cost?",
    sequences=SEQUENCES, frames=30, min_frames=2,
)  # fmt: skip
def ablation(context: ExperimentContext) -> Findings:
    """Evaluate every variant on the same frames."""
    measured = context.evaluate(VARIANTS).measurements
    found = measured.table({heading: selector for heading, (selector, _) in QUANTITIES.items()})
    found *= pd.Series({heading: factor for heading, (_, factor) in QUANTITIES.items()})
    for name, (own, raw) in {"survival": SURVIVAL, "ghosts": GHOSTS}.items():
        shares = measured.table({"own": own, "raw": raw})
        found.insert(found.shape[1] - 1, f"{name} less raw's [points]", 100 * (shares["own"] - shares["raw"]))
    found = found.rename_axis(["sequence", "variant"])
    means = found.groupby("variant", sort=False).mean()
    means.insert(0, "what is off", pd.Series(VARIANTS))
    return Findings(
        tables={
            "table": means.reset_index(),
            "by-sequence": found.reset_index(),
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
            panel_in=(7.0, 4.6),
        ),
    )
