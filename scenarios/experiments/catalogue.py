"""All experiments with the paper's label, what it claims, and how long they take. It imports nothing, for `--help`."""

from typing import NamedTuple


class Entry(NamedTuple):
    """What is known of an experiment before it is imported."""

    label: str
    """Section, table or figure of the paper, as its LaTeX source labels it."""
    claim: str
    minutes: float
    """On two quiet cores with existing recordings."""
    data: str = ""
    """What `--data` names; empty for an experiment that reads none."""
    images: bool = True
    """Whether it looks at images, so that it has sequences, frames and a width."""


TRUE_RECORDINGS = (
    "Recording with the true depth, such as a trajectory of Mid-Air, in place of the sequences; repeatable."
)

CATALOGUE = {
    "rq1": Entry("RQ1, fig:occplot", "quality falls superlinearly with the share of occluded pixels", 1),
    "rq2": Entry("RQ2, fig:resize", "200 x 200 registers best, and three times as fast as larger images", 1),
    "rq3": Entry(
        "RQ3, tab:upsamplingmethods", "dilation inpaints better than bilinear interpolation, convex upsampling best", 1
    ),
    "rq4": Entry("RQ4, subsec:opticalflow", "optical flow follows the scene better, and is far too slow", 1),
    "steps": Entry("fig:flowwithimage, fig:compare", "inpainting makes a dense template of a sparse projection", 0.5),
    "quality": Entry(
        "tab:psnr", "of VD, RS and GS, VD is the nearest to the truth in five of six datasets", 5, TRUE_RECORDINGS
    ),
    "rmse": Entry(
        "tab:psnr, subsubsec:masked",
        "masked RMSE tells methods apart, and VD has the lowest of VD, RS and GS in four of six", 3, TRUE_RECORDINGS,
    ),
    "percentages": Entry("the text of sec:Evaluation", "the percentages follow from the tables", 0.1, images=False),
    "fps": Entry("tab:fps", "over 20 frames/s, by pipelining 21 % more", 2),
    "components": Entry("tab:componentlatency", "fusion takes longest, then inpainting", 0.5),
    "window": Entry("fig:winsize", "windows of 10 frames are as good as 12, and faster", 2),
    "switches": Entry("tab:switchfrequency", "fewer state switches in rendered datasets; flow tells when", 2),
    "collide": Entry(
        "fig:collide", "collisions grow almost quadratically with the noise", 10,
        "Store of the study `noise` (voxdepth study run noise), which is read in place of 25 flights.",
    ),
}  # fmt: skip
"""In the order of the paper."""


def duration_text(minutes: float) -> str:
    """Say how long an experiment takes."""
    return f"{minutes:g} min" if minutes >= 1 else f"{60 * minutes:.0f} s"
