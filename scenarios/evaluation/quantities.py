"""All quantities that the report has a table of, in its order."""

from .cell import AS_GIVEN, FILLED, FRAMES
from .groups import ALL, BINS
from .moving_score import DEPARTED, MOVING
from .quantity import HIDDEN, AgainstRaw, Quantity, SideBySide, millis, one_place, percent, two_places, whole_millis
from .trust_score import SOURCES, WITHIN

BACKGROUND = "latency_background"
"""CPU time per frame of a method's own threads [ms], which the time that the caller waits leaves out."""

IN_PAPERS_LAYOUT = (
    Quantity(
        title="PSNR, peak 65535 mm, surfaces within that, after completion [dB]",
        metrics=["psnr16_mm"],
        within=ALL,
        note="Higher is better.",
        best="high",
        show=two_places,
    ),
    Quantity(
        title="Masked RMSE, occluded pixels within 20 m, after completion [m]",
        metrics=["rmse"],
        mask="occluded",
        note="Lower is better. The paper's masked RMSE has no unit, and is below, beside what repeats its arithmetic.",
        best="low",
    ),
    Quantity(
        title="Masked MAE, occluded pixels within 20 m, after completion [m]",
        metrics=["mae"],
        mask="occluded",
        note="Lower is better.",
        best="low",
    ),
)
FOR_COMPARISON_ONLY = (
    Quantity(
        title="m_rmse_u16_wrap, occluded pixels [no unit]",
        metrics=["m_rmse_u16_wrap"],
        mask="occluded",
        within=ALL,
        on=AS_GIVEN,
        note="The authors' arithmetic, which subtracts and squares in 16 bits. Unrelated images score 179.96, an error "
        "of 256 mm everywhere scores 0: it ranks nothing. Mean over frames.",
        show=two_places,
    ),
    Quantity(
        title="psnr_minmax8 [dB]",
        metrics=["psnr_minmax8"],
        within=ALL,
        on=AS_GIVEN,
        note="The authors' arithmetic, which stretches each image by its own extremes to 8 bits. A copy scaled by 2 "
        "scores 361 dB: it ranks nothing. Mean over frames.",
        show=two_places,
    ),
)
QUANTITIES = (
    Quantity(
        title="Coverage: pixels with depth, surfaces within 20 m [%]",
        metrics=["coverage"],
        on=FILLED,
        show=percent,
        note="Errors of methods that fill less than 90 % say little beside those of others.",
    ),
    Quantity(
        title="MAE of what a method fills, surfaces within 20 m [m]",
        metrics=["mae"],
        on=FILLED,
        note="Not comparable where coverages differ: who leaves the hard pixels out errs less.",
    ),
    Quantity(title="MAE of all pixels within 20 m, after completion by the nearest valid [m]", metrics=["mae"],
             best="low"),
    Quantity(title="RMSE of all pixels within 20 m, after completion [m]", metrics=["rmse"], best="low"),
    Quantity(title="Median error of all pixels within 20 m, after completion [mm]", metrics=["median"], best="low",
             show=millis),
    Quantity(title="RMSE of inverse depth, all surfaces, after completion [1/m]", metrics=["inverse_rmse"],
             within=ALL, best="low", show=lambda value: f"{value:.4f}"),
    Quantity(
        title="MAE in the sensor's holes (held-out pixels where there is no truth), within 20 m, after completion [m]",
        metrics=["mae"],
        mask=HIDDEN,
        best="low",
    ),
    Quantity(
        title="MAE in holes whose surface was measured rightly in the last 60 frames, within 20 m, completed [m]",
        metrics=["mae"],
        mask="holes seen",
        best="low",
        note="What a memory could know.",
    ),
    Quantity(
        title="MAE in holes never seen, within 20 m, after completion [m]",
        metrics=["mae"],
        mask="holes never seen",
        best="low",
        note="What can only be guessed.",
    ),
    Quantity(
        title="Median error of measured pixels within 20 m [mm]",
        metrics=["median"],
        mask="measured",
        on=FILLED,
        best="low",
        show=millis,
    ),
    Quantity(title="RMSE of measured pixels within 20 m [m]", metrics=["rmse"], mask="measured", on=FILLED, best="low"),
    Quantity(
        title="More than 10 % too far / too near in those holes (held-out pixels), within 20 m, after completion [%]",
        metrics=["too_far", "too_near"],
        mask=HIDDEN,
        show=percent,
        note="Together, for a bias to one side wins either alone.",
    ),
    Quantity(
        title="Flicker: mean change of the error of static pixels within 20 m from frame to frame [mm]",
        metrics=["flicker"],
        mask="static",
        on=FILLED,
        show=millis,
        note="Without the truth: of the depth, where the gray image hardly changes.",
    ),
    SideBySide(
        title=f"Flicker by range, {' / '.join(BINS)} [mm]",
        metrics=["flicker"],
        mask="static",
        on=FILLED,
        withins=BINS,
        show=whole_millis,
    ),
    Quantity(
        title="Static pixels within 20 m that gain or lose their depth from frame to frame [%]",
        metrics=["switched"],
        mask="static",
        on=FILLED,
        show=percent,
    ),
    AgainstRaw(
        title="Survival: pixels of moving things within 5 % of the truth, of raw depth, and the method's difference "
        "[%]",
        metrics=["survival", "survival_raw"],
        mask=MOVING,
        within=ALL,
        on=AS_GIVEN,
        best="high",
        show=percent,
        note="A hole does not survive. Only sequences with things that are known to move have it.",
    ),
    AgainstRaw(
        title="Ghosts: filled pixels nearer to the thing that left 5 frames ago than to what is there, of raw depth, "
        "and the method's difference [%]",
        metrics=["ghosts", "ghosts_raw"],
        mask=DEPARTED,
        within=ALL,
        on=FILLED,
        best="low",
        show=percent,
        note="Nearer by the geometric mean. Who leaves such pixels empty has no ghosts: see the sample sizes.",
    ),
    SideBySide(
        title=f"MAE by where a method says that it has the depth from: sensor / memory / inpainted, {WITHIN} [m]",
        metrics=["mae"],
        masks=list(SOURCES.values()),
        within=WITHIN,
        on=FILLED,
        show=two_places,
        note="How many pixels each source has is in results.csv.",
    ),
    Quantity(
        title="Time per frame, median / 95th percentile / in threads of its own beside that [ms]",
        metrics=["latency_p50", "latency_p95", BACKGROUND],
        mask=FRAMES,
        within=FRAMES,
        on=FRAMES,
        show=one_place,
        note="OpenCV on one thread, one method at a time, after a warm-up. The third number is the "
        "mean CPU time of a method's own threads: 'paper' fuses its window in one.",
    ),
    Quantity(
        title="Median time per frame in yardsticks / yardstick before / between frames / after [ms]",
        metrics=["latency_p50_yardsticks", "yardstick_before", "yardstick_during", "yardstick_after"],
        mask=FRAMES,
        within=FRAMES,
        on=FRAMES,
        show=two_places,
        note="The yardstick is a 5x5 median of 640x360 pixels, timed in the same process right before each method's "
        "run, after each of its frames, and right after it. Where it differs from that of other runs, something else "
        "took time from the machine.",
    ),
)  # fmt: skip
