"""Recording sequences, as the command line and as a library."""

import tomllib
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest

from scenarios.errors import ScenarioError
from scenarios.evaluation import moving_ids
from scenarios.files import shipped_names
from scenarios.images import INVALID_REASON_COLORS
from scenarios.sequences import GROUPS, SeededSequence, load_sequence, names_of, record, simulation
from sim.errors import SensorError
from sim.recording import Recording
from sim.types import Capture
from tests.commands import voxdepth
from voxdepth.tools.files import to_toml

SMALL = {"rig.width_px": 128, "rig.height_px": 96}


def small(name: str = "sim-LN", seed: int = 0, **changes: object) -> SeededSequence:
    return load_sequence(name, seed, {**SMALL, **changes})


def captures(planned: SeededSequence, frames: int) -> list[Capture]:
    """The first captures of a sequence, without files."""
    with simulation(planned) as simulated:
        return [simulated.sensor.capture(pair) for pair in simulated.render(frames)]


def assert_same(a: Capture, b: Capture) -> None:
    for name in vars(a):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name, strict=True)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.slow) if name != "sim-cut" else name for name in shipped_names("sequences")],
)
def test_every_sequence_is_recorded_and_read_back_bit_for_bit(name: str, tmp_path: Path) -> None:
    planned, message = small(name), list[int]()
    record(planned, tmp_path / "r", 3, message.append)
    recording = Recording.open(tmp_path / "r")
    assert message == [0, 1, 2, len(recording)]
    expected = captures(planned, 3)
    for one, other in zip(recording, expected, strict=True):
        assert_same(one, other)
    assert len({capture.gray_left.tobytes() for capture in expected}) == 3, "the camera moves"
    assert (expected[0].depth_raw_m > 0).mean() > 0.05


@pytest.mark.slow
def test_the_shipped_sequences_have_the_sizes_and_the_length_of_the_papers() -> None:
    sizes = {name: load_sequence(name, 0, {}).sequence.rig for name in shipped_names("sequences")}
    assert set(sizes) == set(names_of(["reference", "hard", "artefacts"]))
    rooms = [sizes.pop(name) for name in names_of(["artefacts"])][:-1]
    assert {(rig.width_px, rig.height_px, round(rig.intrinsics.fx_px, 1)) for rig in rooms} == {(640, 360, 465.6)}
    for name, rig in sizes.items():
        realsense = name in ("sim-LN", "sim-MB", *GROUPS["hard"])
        assert (rig.width_px, rig.height_px) == ((640, 360) if realsense else (1024, 1024))
        assert rig.intrinsics.fx_px == pytest.approx(343.2 if realsense else 512, abs=0.1)
        assert rig.rate_hz == 30
    for name in shipped_names("sequences"):
        with simulation(small(name)) as simulated:
            assert sum(1 for _, pose in zip(range(500), simulated.exposures(), strict=False)) == 500


@pytest.mark.slow
def test_sunny_and_cloudy_are_the_same_flight() -> None:
    (sunny,), (cloudy,) = (captures(small(name), 1) for name in ("sim-KTS", "sim-KTC"))
    np.testing.assert_array_equal(sunny.depth_true_m, cloudy.depth_true_m)
    seen = np.isfinite(sunny.depth_true_m)
    assert sunny.gray_left[seen].std() > 1.3 * cloudy.gray_left[seen].std()


def test_a_mover_is_in_the_recording_where_its_path_says_and_known_by_its_id(tmp_path: Path) -> None:
    planned = small("sim-cross", **{"flight.sway_m": 0.0, "flight.sway_deg": 0.0, "rig.depth": "truth"})
    record(planned, tmp_path / "r", 32, lambda frames: None)
    recording = Recording.open(tmp_path / "r")
    assert list(moving_ids(recording)) == [0]
    (before, during, after) = (recording[index] for index in (0, 27, 31))
    assert not (before.segment_id == 0).any(), "it begins outside of the view"
    columns = [np.nonzero(capture.segment_id == 0)[1].mean() for capture in (during, after)]
    i = recording.intrinsics
    for column, time_s in zip(columns, (27 / 30, 31 / 30), strict=True):
        left_m = 2.3 - 2.5 * time_s - (i.baseline_m or 0) / 2
        assert column == pytest.approx(i.cx_px - i.fx_px * left_m / 2.0, abs=0.7)
    nearest_m = during.depth_true_m[during.segment_id == 0].min()
    assert nearest_m == pytest.approx(1.75, abs=0.01)


def test_a_recording_without_movers_says_what_it_always_said(tmp_path: Path) -> None:
    planned = small()
    assert "movers" not in to_toml(planned)
    record(planned, tmp_path / "r", 1, lambda frames: None)
    assert not moving_ids(Recording.open(tmp_path / "r"))
    for text in ("seed = 0", "sequence = 3", "[sequence]\nmovers = 7\n[versions]"):
        other = Recording(tmp_path, [], planned.sequence.rig.intrinsics, text)
        assert not moving_ids(other), text


@pytest.mark.parametrize("name", ["sim-stations", "sim-cut", "sim-ghost"])
def test_a_shutter_needs_a_steady_flight_among_bodies_that_stand(name: str) -> None:
    with pytest.raises(ScenarioError, match=r"shutter needs a camera that moves steadily among bodies that stand"):
        small(name, **{"rig.shutter": 0.25})


def test_a_shutter_is_open_from_the_time_of_its_frame_on() -> None:
    planned = small("sim-blur", **{"rig.shutter": 0.25, "rig.rate_hz": 20.0})
    with simulation(planned) as simulated:
        frames = list(islice(simulated.exposures(), 4))
        *_, pair = simulated.render(4)
    for k, poses in enumerate(frames):
        np.testing.assert_allclose([pose.stamp_s for pose in poses], k / 20 + np.arange(3) / 240)
    assert pair.pose.stamp_s == frames[3][1].stamp_s


@pytest.mark.parametrize(
    ("from_m", "speed_m_s", "rig", "message"),
    [
        ((1.0, 0.0, 0.0), 5.0, {}, "in frame [45] the left camera"),
        ((0.0, -0.4, 0.0), 1.0, {}, "in frame [2-5] the right camera"),
        ((0.0, 0.65, 0.0), 1.0, {"rig.color_offset_m": 0.3}, "in frame [0-9] the color camera"),
    ],
)
def test_a_mover_that_reaches_a_camera_is_refused_and_its_recording_is_absent(
    from_m: tuple[float, ...], speed_m_s: float, rig: dict[str, float], message: str, tmp_path: Path
) -> None:
    into_the_lens = [{"from_m": from_m, "to_m": [-x for x in from_m], "speed_m_s": speed_m_s}]
    with pytest.raises(SensorError, match=f"{message} is inside a body"):
        record(small("sim-approach", movers=into_the_lens, **rig), tmp_path / "r", 9, lambda frames: None)
    assert not list(tmp_path.iterdir())


def test_a_flight_that_is_too_short_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    short = small("sim-LN", **{"flight.start_m": 98.0, "flight.speed_m_s": 40.0})
    with pytest.raises(ScenarioError, match=r"ends after \d frames, expected 20") as caught:
        record(short, tmp_path / "r", 20, lambda frames: None)
    assert not (tmp_path / "r").exists()
    longest = int(str(caught.value).split("--frames ")[1][0])
    record(short, tmp_path / "r", longest, lambda frames: None)
    assert len(Recording.open(tmp_path / "r")) == longest


@pytest.mark.slow
def test_record_and_sheet_as_commands(tmp_path: Path) -> None:
    folder = tmp_path / "r"
    command = ["record", "sim-MB", "--out", folder, "--frames", "3", "--size", "160x96", "--seed", "4"]
    done = voxdepth(*command)
    assert done.returncode == 0, done.stderr
    assert "3 frames of sim-MB, seed 4" in done.stdout
    config = tomllib.loads((folder / "config.toml").read_text())
    assert config["seed"] == 4
    assert "numpy" in config["versions"]
    assert voxdepth(*command).stderr.strip().endswith("is not empty; name a new folder")
    sheet = voxdepth("picture", folder, "--out", tmp_path / "s.png")
    assert sheet.returncode == 0, sheet.stderr
    picture = cv2.imread(str(tmp_path / "s.png"))
    colors = {tuple(color) for color in picture[..., ::-1].reshape(-1, 3).tolist()}
    assert set(INVALID_REASON_COLORS.values()) <= colors, "the legend names every reason"
    repeated = voxdepth("record", folder / "config.toml", "--out", tmp_path / "again", "--frames", "3")
    assert repeated.returncode == 0, repeated.stderr
    assert Recording.open(tmp_path / "again").digest(3) == Recording.open(folder).digest(3)


@pytest.mark.slow
def test_scenes_are_pictured(tmp_path: Path) -> None:
    done = voxdepth("picture", "scenes", "--out", tmp_path / "scenes.jpg")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "scenes.jpg").stat().st_size < 500_000
