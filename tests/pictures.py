"""The pictures of how the methods work that documents show, each remade by one command.

    python -m tests.pictures [NAME ...]

Without a name all are made. They are drawn from what the code itself computes, so that they show what it does today:
`steps` runs the program of docs/steps.md.
"""

import argparse
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from scenarios.figure import Draw, image_shown, new_figure, panel_figure
from scenarios.images import hex_color, save_picture
from sim import frames
from swarm.perception import frame_of
from tests.workloads import captures
from voxdepth.colors import SOURCE_COLORS, colored
from voxdepth.errors import no_such
from voxdepth.paper.epochs import EpochEnd, Phase
from voxdepth.paper.method import VoxDepth
from voxdepth.temporal import filling
from voxdepth.temporal.config import TemporalConfig
from voxdepth.temporal.roughness import roughness
from voxdepth.temporal.steps import Measurement, Memory, PixelClass, Prediction, Steps
from voxdepth.types import FloatImage, GrayImage, Intrinsics, Source

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)
Figures = Mapping[str, Figure]
"""Figures by the paths of their files below docs/."""
PANEL_IN = (3.3, 2.1)
FAR_M, BEYOND_SHARE = 1.0, 0.1
"""Depth at the blue end of the colours in pictures of the sample, whose table is nearer."""
CLASS_COLORS = {
    PixelClass.UNMEASURED: (0, 0, 0),
    PixelClass.FUSED: (150, 150, 150),
    PixelClass.MEASURED: (70, 170, 90),
    PixelClass.REMEMBERED: SOURCE_COLORS[Source.MEMORY],
}
"""Colour of a pixel by its class, RGB."""
CLASS_NAMES = {
    PixelClass.UNMEASURED: "hole",
    PixelClass.FUSED: "mean of both",
    PixelClass.MEASURED: "measurement",
    PixelClass.REMEMBERED: "memory",
}


def page_code() -> list[str]:
    """Return the programs of docs/steps.md, in their order."""
    return BLOCK.findall((DOCS / "steps.md").read_text(encoding="utf-8"))


class Of(NamedTuple):
    """How disparity of a camera is drawn."""

    focal_baseline_px_m: float

    def disparity(self, title: str, disparity_px: FloatImage) -> Draw:
        """Draw disparity in the colours of its depth."""
        known = disparity_px > 0
        depth_m = np.divide(self.focal_baseline_px_m, disparity_px, out=np.zeros_like(disparity_px), where=known)
        return depth(title, depth_m)


def depth(title: str, depth_m: FloatImage) -> Draw:
    """Draw depth: red is near, blue is far, and black is a hole."""
    return image_shown(title, colored(depth_m, FAR_M)[..., ::-1], interpolation="nearest")


def scaled(title: str, image: Any, highest: float, color_map: str = "viridis", lowest: float = 0.0) -> Draw:
    """Draw numbers, with a bar that says which they are."""

    def draw(axes: Axes) -> None:
        shown = axes.imshow(image, vmin=lowest, vmax=highest, cmap=color_map, interpolation="nearest")
        axes.set_title(title, fontsize=8)
        axes.set_axis_off()
        bar = axes.figure.colorbar(shown, ax=axes, shrink=0.8, pad=0.01)
        bar.ax.tick_params(labelsize=6)

    return draw


def labelled(
    title: str, labels: GrayImage, colors: Mapping[Any, tuple[int, int, int]], names: Mapping[Any, str]
) -> Draw:
    """Draw an image of labels, with a legend."""
    palette = np.zeros((256, 3), np.uint8)
    for label, color in colors.items():
        palette[label] = color

    def draw(axes: Axes) -> None:
        image_shown(title, palette[labels], interpolation="nearest")(axes)
        patches = [Patch(color=hex_color(colors[label]), label=name) for label, name in names.items()]
        axes.legend(handles=patches, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=4, fontsize=6, frameon=False)

    return draw


def steps() -> Figures:
    """Draw what each step of the default method makes of a frame of the sample."""
    made: dict[str, Any] = {}
    first, *calls = page_code()
    exec(first, made)
    for code in calls[:9]:
        exec(code, made)
    frame, before, fusion, fills = (made[name] for name in ("frame", "memory_before", "fusion", "fills"))
    measurement, memory, shown = made["measurement"], made["prediction"].memory, made["shown"]
    resolution, fused = made["steps"].resolution, fusion.fused
    of = Of(resolution.focal_baseline_px_m)
    whole_px = fused.disparity_px + fills.working.disparity_px
    is_hole = fused.disparity_px == 0
    sources = {source: name.lower() for source, name in zip(Source, Source.__members__, strict=True)}
    panels: dict[str, Sequence[Draw]] = {
        "1-measure": (
            depth("depth of the frame, 640x360", frame.depth_m),
            of.disparity("its disparity at half size", measurement.disparity_px),
            scaled("weight, in measurements", measurement.weight / 16, 1.0),
        ),
        "2-track": (
            image_shown("keyframe", made["tracking_before"].image.gray, cmap="gray"),
            tracks("corners, and where they were in the keyframe", made),
        ),
        "3-warp": (
            of.disparity("memory of the keyframe", before.disparity_px),
            of.disparity("the same in the pixels of the frame", memory.disparity_px),
        ),
        "4-fuse": (
            of.disparity("disparity, fused", fused.disparity_px),
            labelled("what it is", fused.pixel_class, CLASS_COLORS, CLASS_NAMES),
        ),
        "5-fill": (
            of.disparity("with holes", fused.disparity_px),
            of.disparity("filled", whole_px),
            scaled("probability of the fills", np.where(is_hole, fills.working.probability, np.nan), 1.0),
        ),
        "6-remember": (
            of.disparity("memory after the frame", fusion.memory.disparity_px),
            scaled("number of measurements", fusion.memory.weight / 16, 12.0),
        ),
        "7-smooth": smoothed(of, whole_px, made["disparity_px"]),
        "8-confidence": (
            scaled("roughness of the measured depth [px]", roughness(frame.depth_m, resolution), 0.5, "magma"),
            scaled("confidence", made["estimates"].working.confidence, 1.0),
        ),
        "9-upsample": (
            depth("depth as measured", frame.depth_m),
            depth("depth as corrected", shown.depth_m),
            labelled("source", shown.source, SOURCE_COLORS, sources),
        ),
    }
    return {f"steps/{name}.jpg": panel_figure("", draws, panel_in=PANEL_IN) for name, draws in panels.items()}


def tracks(title: str, made: Mapping[str, Any]) -> Draw:
    """Draw how far the image has moved at the corners that have a remembered depth."""
    tracking, resolution, memory = made["tracking"], made["steps"].resolution, made["fusion"].memory
    corners = tracking.image.corners.astype(int)
    now_px = memory.disparity_px[corners[:, 1], corners[:, 0]]
    corners, now_px = corners[now_px > 0], now_px[now_px > 0]
    rays = np.column_stack([corners, np.ones(len(corners))]) @ resolution.K_inverse.T
    points_m = rays * (resolution.focal_baseline_px_m / now_px)[:, None]
    T_keyframe_frame = np.linalg.inv(tracking.T_frame_keyframe)
    seen = (points_m @ T_keyframe_frame[:3, :3].T + T_keyframe_frame[:3, 3]) @ resolution.K.T
    moved = corners - seen[:, :2] / seen[:, 2:]

    def draw(axes: Axes) -> None:
        image_shown(title, tracking.image.gray, cmap="gray")(axes)
        axes.quiver(
            *(corners - moved).T, *moved.T, angles="xy", scale_units="xy", scale=1, color="#ff8c1a", width=0.004
        )
        axes.set_xlim(0, tracking.image.gray.shape[1])
        axes.set_ylim(tracking.image.gray.shape[0], 0)

    return draw


def smoothed(of: Of, before_px: FloatImage, after_px: FloatImage) -> Sequence[Draw]:
    """Draw a part of the disparity before and after it is smoothed."""
    part = np.s_[20:110, 100:260]
    low_px, high_px = np.percentile(after_px[part], (15, 99))
    return (
        scaled("a part of the disparity before [px]", before_px[part], high_px, lowest=low_px),
        scaled("after [px]", after_px[part], high_px, lowest=low_px),
        scaled("difference [px]", (after_px - before_px)[part], 0.5, "RdBu", -0.5),
    )


AXES_OF_RAYS = {"row": (0, 1), "column": (1, 0), "diagonal \\": (1, 1), "diagonal /": (1, -1)}
"""Direction of the second ray of each axis, in rows and columns."""
LINE_STYLES = ("-", "--", ":", "-.")


class Ray(NamedTuple):
    """A ray from a hole to the nearest pixel with a disparity."""

    row: int
    col: int
    steps: int
    disparity_px: float

    @classmethod
    def of(cls, disparity_px: FloatImage, row: int, col: int, down: int, right: int) -> "Ray":
        """Follow a ray within the image."""
        steps = 1
        while disparity_px[row + steps * down, col + steps * right] == 0:
            steps += 1
        at = row + steps * down, col + steps * right
        return cls(*at, steps, float(disparity_px[at]))


class Vote(NamedTuple):
    """A vote of a hole, by the table in `voxdepth/temporal/filling.py`."""

    name: str
    disparity_px: float
    weight: float


def vote_of(name: str, ends: tuple[Ray, Ray], decimation: int, factors: Mapping[str, float]) -> Vote:
    """Return the vote of an axis with two ends: the same arithmetic as the compiled loop, for people to read."""
    (before, after), is_row = ends, name == "row"
    spacing_px = decimation * (np.sqrt(2) if name.startswith("diagonal") else 1)
    one, other = 1 / (before.steps * spacing_px), 1 / (after.steps * spacing_px)
    length, jump_px = before.steps + after.steps, abs(before.disparity_px - after.disparity_px)
    linear_px = (before.disparity_px * after.steps + after.disparity_px * before.steps) / length
    if is_one_surface(before.disparity_px, after.disparity_px):
        return Vote(name, linear_px, 2 * (one + other) * (factors["row"] if is_row else 1))
    if jump_px <= factors["slope"] * decimation * length:
        return Vote(name, linear_px, one + other)
    if after.disparity_px < before.disparity_px:
        return Vote(name, after.disparity_px, other)
    is_shadow = is_row and (length - 1) * decimation <= 2 * jump_px
    return Vote(name, before.disparity_px, one * (factors["shadow"] if is_shadow else 1))


def is_one_surface(one_px: float, other_px: float) -> bool:
    """Return whether two disparities are of one surface."""
    return abs(one_px - other_px) <= filling.AGREEMENT_PX + filling.AGREEMENT_SHARE * max(one_px, other_px)


def elected_px(votes: Sequence[Vote]) -> float:
    """Return the mean of the votes for the surface that has the largest support."""
    supporters = [[vote for vote in votes if is_one_surface(vote.disparity_px, one.disparity_px)] for one in votes]
    best = max(supporters, key=lambda each: sum(vote.weight for vote in each))
    return float(np.average([vote.disparity_px for vote in best], weights=[vote.weight for vote in best]))


HOLE = 60, 49
"""Row and column of the hole whose rays are drawn: in the occlusion shadow of the table."""


class Drawn(NamedTuple):
    """A hole of the sample with its rays and its votes."""

    fused_px: FloatImage
    """Disparity with holes, shape (h, w)."""
    ends: Mapping[str, tuple[Ray, Ray]]
    """Both rays of each axis, by its name."""
    votes: Sequence[Vote]
    filled_px: float
    """What the method fills the hole with."""
    of: Of


def votes_of_hole() -> Drawn:
    """Return the rays and the votes of the hole that is drawn."""
    made: dict[str, Any] = {}
    for code in page_code()[:6]:
        exec(code, made)
    fused, memory, resolution = made["fusion"].fused, made["prediction"].memory, made["steps"].resolution
    ends = {
        name: (Ray.of(fused.disparity_px, *HOLE, -down, -right), Ray.of(fused.disparity_px, *HOLE, down, right))
        for name, (down, right) in AXES_OF_RAYS.items()
    }
    shadow_factor = TemporalConfig().shadow_factor
    factors = {"row": filling.ROW_FACTOR, "slope": filling.MAX_SLOPE, "shadow": shadow_factor}
    votes = [vote_of(name, both, resolution.decimation, factors) for name, both in ends.items()]
    evidence = fused.weight[HOLE] / 16 / (1 + made["prediction"].motion_px2)
    others = (
        Vote("memory", fused.remembered_px[HOLE], (1 + evidence) * filling.MEMORY_WEIGHT),
        Vote("previous fill", memory.filled_px[HOLE], filling.PREVIOUS_WEIGHT),
    )
    votes += [vote for vote in others if vote.disparity_px > 0]
    filled_px = float(made["fills"].working.disparity_px[HOLE])
    return Drawn(fused.disparity_px, ends, votes, filled_px, Of(resolution.focal_baseline_px_m))


def rays() -> Figures:
    """Draw the eight rays of a hole of the sample, and the votes that come of them."""
    drawn = votes_of_hole()
    panels = rays_drawn(drawn), votes_drawn(drawn.votes, elected_px(drawn.votes))
    return {"corrector/rays.png": panel_figure("", panels, panel_in=(4.6, 3.4))}


def rays_drawn(drawn: Drawn) -> Draw:
    """Draw a part of a disparity image with the rays of a hole."""
    row, col = HOLE
    rows, cols = part = np.s_[row - 60 : row + 60, col - 49 : col + 100]

    def draw(axes: Axes) -> None:
        title = "eight rays from a hole; numbers: disparity of their ends [px]"
        drawn.of.disparity(title, drawn.fused_px[part])(axes)
        for (name, pair), style in zip(drawn.ends.items(), LINE_STYLES, strict=True):
            for ray in pair:
                line = (col - cols.start, ray.col - cols.start), (row - rows.start, ray.row - rows.start)
                axes.plot(*line, style, color="white", linewidth=1.2, label=name)
                text = {"fontsize": 7, "ha": "center", "va": "center", "bbox": {"fc": "white", "ec": "none", "pad": 1}}
                axes.text(line[0][1], line[1][1], f"{ray.disparity_px:.1f}", **text)
        axes.plot(col - cols.start, row - rows.start, "o", color="#ff3030", markersize=5)
        axes.set_xlim(0, cols.stop - cols.start)
        axes.set_ylim(rows.stop - rows.start, 0)

    return draw


def votes_drawn(votes: Sequence[Vote], winner_px: float) -> Draw:
    """Draw the votes of a hole by disparity and weight, and which of them win."""

    def draw(axes: Axes) -> None:
        names = [vote.name for vote in votes]
        wins = [is_one_surface(vote.disparity_px, winner_px) for vote in votes]
        colors = ["#2a78c8" if each else "#b0b0b0" for each in wins]
        axes.barh(names, [vote.weight for vote in votes], color=colors)
        for name, vote in zip(names, votes, strict=True):
            axes.text(vote.weight, name, f" {vote.disparity_px:.1f} px", va="center", fontsize=8)
        axes.invert_yaxis()
        axes.set_xlim(0, 1.3 * max(vote.weight for vote in votes))
        axes.set_xlabel("weight of the vote", fontsize=8)
        axes.tick_params(labelsize=8)
        axes.set_title(f"blue votes win: the hole becomes {winner_px:.1f} px", fontsize=8)

    return draw


SMALL = Intrinsics.from_hfov(width_px=80, height_px=40, hfov_deg=60, baseline_m=0.05)
WALL_PX, THING_PX, WEIGHT = 6.0, 12.0, 5
"""Disparity of a wall and of a thing before it, and number of measurements that the memory is made of."""


def fusion() -> Figures:
    """Draw the four cases of fusion: what is shown, and what happens to the memory."""
    noise_px = np.random.default_rng(0).normal(0, 0.25, SMALL.shape).astype(np.float32)
    wall_px, thing_px = np.full(SMALL.shape, WALL_PX, np.float32), np.full(SMALL.shape, WALL_PX, np.float32)
    thing_px[:, 30:50], outlier_px = THING_PX, wall_px.copy()
    outlier_px[20:22, 40:42] = THING_PX
    cases = {
        "agreeing: the mean is shown": (wall_px, wall_px + noise_px),
        "occluding: the measurement is shown": (wall_px, thing_px + noise_px),
        "free space: the measurement is shown": (thing_px, wall_px + noise_px),
        "outlier: the memory is shown": (wall_px, outlier_px + noise_px),
    }
    draws = [fusion_drawn(title, *both) for title, both in cases.items()]
    return {"corrector/fusion.png": panel_figure("", draws, columns=2, panel_in=(4.4, 2.7), shared_legend=True)}


def fusion_drawn(title: str, remembered_px: FloatImage, measured_px: FloatImage) -> Draw:
    """Draw a row of a memory, of a measurement, and of what comes of both."""
    gray, units = np.zeros(SMALL.shape, np.uint8), np.full(SMALL.shape, 16, np.uint8)
    empty = Memory.empty(gray)
    memory = empty._replace(disparity_px=remembered_px, weight=units * np.uint8(WEIGHT), seen_px=remembered_px)
    memory = memory._replace(age=np.full_like(gray, WEIGHT))
    made = Steps(SMALL).fuse(Prediction(memory, 0.0), Measurement(measured_px, units, gray))
    row, at = 20, 40

    def draw(axes: Axes) -> None:
        axes.plot(remembered_px[row], color="#2a78c8", linewidth=3, alpha=0.5, label="memory before")
        axes.plot(measured_px[row], ".", color="#606060", markersize=4, label="measurement")
        axes.plot(made.fused.disparity_px[row], color="#e07800", linewidth=1.3, label="shown")
        axes.set_ylim(4, 14)
        axes.set_title(title, fontsize=9)
        after = made.memory.weight[row, at] / 16
        axes.text(
            0.03, 0.9, f"weight of the memory in the middle: {WEIGHT} before, {after:.3g} after",
            transform=axes.transAxes, fontsize=8,
        )  # fmt: skip
        axes.set_xlabel("column", fontsize=8)
        axes.set_ylabel("disparity [px]", fontsize=8)
        axes.tick_params(labelsize=7)

    return draw


EPOCH_SEQUENCE, EPOCH_FRAMES = "sim-LN", 100
PHASE_COLORS = {Phase.PASSTHROUGH: "#c8c8c8", Phase.FUSING: "#f0a028", Phase.CORRECTING: "#46aa5a"}
PHASE_NAMES = {
    Phase.PASSTHROUGH: "no template fits: the frame leaves as measured",
    Phase.FUSING: "the template of the last epoch corrects, while a window is collected and fused",
    Phase.CORRECTING: "the template of the epoch corrects",
}


def epochs() -> Figures:
    """Draw the epochs of the paper's method over a sequence."""
    found = list(captures(EPOCH_SEQUENCE, EPOCH_FRAMES, **{"rig.width_px": 320, "rig.height_px": 240}))
    corrector = VoxDepth(found[0].intrinsics)
    states = [corrector.process(frame_of(capture)).diagnostics for capture in found]
    figure = new_figure((9.0, 3.2), 110)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1, 2))
    for k, state in enumerate(states):
        upper.axvspan(k, k + 1, color=PHASE_COLORS[state.phase])
    ends = [(k, state.epoch_end) for k, state in enumerate(states) if state.epoch_end is not EpochEnd.NONE]
    begins = [k for k, state in enumerate(states) if state.new_epoch]
    for k in begins:
        upper.text(k + 0.7, 0.5, f"{states[k].epoch}", va="center", fontsize=9)
        lower.axvline(k, color="black", linewidth=0.8)
    for k, reason in ends:
        lower.axvline(k + 0.5, color="#d03030", linewidth=1, linestyle="--")
        offset = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points", "fontsize": 7}
        lower.annotate(f"ends: {reason.value.replace('_', ' ')}", (k + 0.5, 1), (4, -10), color="#d03030", **offset)
    matches = [state.registration.n_matches if state.template is not None else np.nan for state in states]
    lower.plot(np.arange(len(states)) + 0.5, matches, ".-", color="#2a78c8", markersize=4, linewidth=1)
    lower.set_ylabel("good matches\nwith the template", fontsize=8)
    lower.set_xlabel("frame", fontsize=8)
    lower.set_ylim(bottom=0)
    upper.set_yticks([])
    upper.set_ylabel("number of\nthe epoch", fontsize=8)
    upper.set_xlim(0, len(states))
    lower.tick_params(labelsize=8)
    patches = [Patch(color=PHASE_COLORS[phase], label=name) for phase, name in PHASE_NAMES.items()]
    figure.legend(handles=patches, loc="outside upper center", fontsize=7, ncols=3, frameon=False)
    return {"epochs.png": figure}


DRONE_M, MOUNT_M, YAW_RAD = np.array([1.5, 0.7, 0.5]), np.array([0.9, 0.1, 0.0]), -0.4
"""A drone in the world, and its camera in the body; the camera is drawn farther ahead than it is mounted."""
LOOK = np.array([[0.87, 0.50, 0.0], [-0.21, 0.37, 0.91]])
"""The right and the upward direction of the picture in the world, shape (2, 3)."""
AXIS_COLORS = {"x": "#d03030", "y": "#2f9e44", "z": "#2a78c8"}


def axes() -> Figures:
    """Draw the axes of world, body and camera."""
    q = frames.quaternion_from_yaw(YAW_RAD)
    placed = {
        ("world: z up", -0.35): np.eye(4),
        ("body: x forward, y left, z up", 0.7): frames.pose(frames.rotation_from_quaternion(q), DRONE_M),
        ("camera: x right, y down, z forward", -0.8): frames.camera_pose(DRONE_M, q, MOUNT_M),
    }
    figure = new_figure((7.4, 3.4), 110)
    plane = figure.subplots()
    origins = [LOOK @ T[:3, 3] for T in placed.values()]
    for start, end, text in zip(origins, origins[1:], ("T_world_body", "T_body_cam"), strict=False):
        plane.plot(*np.stack([start, end], axis=1), "--", color="#909090", linewidth=1)
        plane.text((start + end)[0] / 2, (start + end)[1] / 2 + 0.06, text, fontsize=8, color="#505050", ha="center")
    for ((name, above), T), origin in zip(placed.items(), origins, strict=True):
        for (axis, color), column in zip(AXIS_COLORS.items(), T[:3, :3].T, strict=True):
            arrow = LOOK @ column
            plane.annotate(
                "", origin + 0.5 * arrow, origin, arrowprops={"arrowstyle": "-|>", "color": color, "linewidth": 2}
            )
            plane.text(*(origin + 0.56 * arrow), axis, color=color, fontsize=10, ha="center", va="center")
        plane.text(origin[0], origin[1] + above, name, fontsize=9, ha="center")
    plane.set(xlim=(-0.6, 3.8), ylim=(-0.8, 1.5), aspect="equal")
    plane.set_axis_off()
    return {"axes.png": figure}


MAKERS: dict[str, Callable[[], Figures]] = {each.__name__: each for each in (steps, rays, fusion, epochs, axes)}


def main(arguments: Sequence[str] | None = None) -> None:
    """Make pictures, all or those that are named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", metavar="NAME", nargs="*", help=", ".join(MAKERS))
    names = parser.parse_args(arguments).names
    if unknown := [name for name in names if name not in MAKERS]:
        parser.error(no_such("picture", unknown[0], MAKERS))
    for name in names or MAKERS:
        for path, figure in MAKERS[name]().items():
            save_picture(DOCS / path, figure)
            print(f"docs/{path}")


if __name__ == "__main__":
    main()
