"""The sensor model `fitted` makes the errors of `stereo`, distance by distance."""

from functools import cache

import numpy as np
import pytest

from sim.frames import quaternion_from_yaw
from sim.render import create_renderer
from sim.scenes import CitySpec
from sim.sensor import RigConfig, StereoSensor
from sim.types import BodyPose, Capture
from sim.world import World
from tests.helpers import block, captured, wall

RIG = RigConfig(width_px=240, height_px=180, decimate=3)
RANGES_M = (0.5, 4.0), (4.0, 8.0), (8.0, 12.0), (12.0, 20.0), (20.0, 40.0)


@cache
def flight(depth: str, blank_share: float) -> list[Capture]:
    """Captures of a flight between towers, to and fro."""
    scene = CitySpec(columns=2, rows=4, poles=4, blank_share=blank_share).build(3)
    with World(scene, np.zeros((0, 3))) as world:
        config = RIG.model_copy(update={"depth": depth})
        sensor = StereoSensor(world, create_renderer("raster", world), config, seed=1, gray=False)
        ways = [(x_m, 5.0 * np.sin(x_m / 4), turn) for turn in (0.0, 0.5, -0.5, np.pi) for x_m in range(-8, 28, 2)]
        poses = [
            BodyPose(stamp_s=i / 10, position_m=np.array([x_m, y_m, 6.0]), q_world_body_xyzw=quaternion_from_yaw(yaw))
            for i, (x_m, y_m, yaw) in enumerate(ways)
            if world.clearance_at_m([x_m, y_m, 6.0]) > 0.8
        ]
        assert len(poses) > 30
        return [sensor.capture(pair) for i, pose in enumerate(poses) for pair in sensor.render([pose], i)]


def shares(depth: str, blank_share: float, range_m: tuple[float, float]) -> dict[str, float]:
    """Shares of the pixels in a range of true distances."""
    captures = flight(depth, blank_share)
    true_m, depth_m = (np.stack([getattr(c, name) for c in captures]) for name in ("depth_true_m", "depth_raw_m"))
    here = (true_m >= range_m[0]) & (true_m < range_m[1])
    valid, error = depth_m[here] > 0, depth_m[here] / true_m[here] - 1
    return {
        "within 5 %": np.mean(valid & (np.abs(error) < 0.05)),
        "within 10 %": np.mean(valid & (np.abs(error) < 0.1)),
        "holes": np.mean(~valid),
        "too far": np.mean(valid & (error >= 0.1)),
        "too near": np.mean(valid & (error <= -0.1)),
    }


@pytest.mark.parametrize("range_m", RANGES_M)
@pytest.mark.parametrize("blank_share", [0.0, 0.3])
def test_the_shares_of_good_missing_and_wrong_depth_are_those_of_stereo(
    blank_share: float, range_m: tuple[float, float]
) -> None:
    stereo, fitted = (shares(depth, blank_share, range_m) for depth in ("stereo", "fitted"))
    assert fitted == pytest.approx(stereo, abs=0.12)


def test_the_sky_is_as_often_missing_or_hidden_behind_grown_surfaces() -> None:
    stereo, fitted = (
        np.concatenate([c.depth_raw_m[np.isinf(c.depth_true_m)] for c in flight(depth, 0.0)])
        for depth in ("stereo", "fitted")
    )
    assert np.mean(fitted == 0) == pytest.approx(np.mean(stereo == 0), abs=0.1)
    assert np.mean((fitted > 0) & (fitted < 20)) == pytest.approx(np.mean((stereo > 0) & (stereo < 20)), abs=0.1)


def test_depth_flickers_as_often() -> None:
    changed = {}
    for depth in ("stereo", "fitted"):
        scene = CitySpec(columns=2, rows=4, poles=4).build(3)
        with World(scene, np.zeros((0, 3))) as world:
            config = RIG.model_copy(update={"depth": depth})
            sensor = StereoSensor(world, create_renderer("raster", world), config, seed=1, gray=False)
            at = {"position_m": np.array([-8.0, 0.0, 6.0]), "q_world_body_xyzw": quaternion_from_yaw(0.0)}
            images = [
                sensor.capture(sensor.render([BodyPose(stamp_s=i / 10, **at)], i)[0]).depth_raw_m for i in range(20)
            ]
        before_m, after_m = np.stack(images[:-1]), np.stack(images[1:])
        changed[depth] = np.mean(np.abs(after_m - before_m) > 0.1 * np.maximum(before_m, after_m))
    assert changed["fitted"] == pytest.approx(changed["stereo"], abs=0.12)


@pytest.mark.parametrize("decimate", [1, 3])
def test_the_second_camera_misses_the_same_pixels(decimate: int) -> None:
    rigs = [RIG.model_copy(update={"depth": depth, "decimate": decimate}) for depth in ("stereo", "fitted")]
    stereo, fitted = (captured(rig, wall(6.0), block(2.0, 1.0)).occluded for rig in rigs)
    assert stereo.any()
    assert np.mean(stereo != fitted) < 0.01
