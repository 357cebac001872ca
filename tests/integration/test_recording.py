"""What a recording holds."""

from contextlib import closing
from itertools import pairwise
from pathlib import Path
from time import sleep
from typing import Any

import cv2
import numpy as np
import pytest
import rerun as rr

from scenarios.config import Run, images_of, load_run
from scenarios.errors import ScenarioError
from scenarios.flight import flying
from scenarios.rerun.mission import CHUNK_S, HEADING_M, MissionRecorder, cloud
from sim.frames import rotation_from_quaternion
from sim.types import Contact
from swarm.environments.gym_env import LeaderFollowerEnv
from swarm.recorder import CaptureRecorder
from tests.frames import promised_entities
from tests.learning import quick
from voxdepth.registry import AUTHORS, METHODS_OF_THE_PAPER, PAPER
from voxdepth.tools.stream import REPLACED, depth_png
from voxdepth.types import Source

IMAGE_EVERY = 2


def planned(path: Path, **changes: Any) -> tuple[Run, MissionRecorder]:
    """A flight of two drones for a second, and what records it."""
    short = {"mission.drones": 2, "mission.duration_s": 1.0, "recording.image_every": IMAGE_EVERY, **images_of(96, 54)}
    run = load_run("city", 0, {**short, **changes})
    return run, MissionRecorder(path, run)


def recorded(path: Path, **changes: Any) -> Path:
    """Record a second of two drones at 20 decisions and 10 images per second; warnings of Rerun are errors."""
    run, recorder = planned(path, **changes)
    rr.set_strict_mode(True)
    try:
        with flying(run, recorder, recorded=True) as mission:
            mission.run()
    finally:
        rr.set_strict_mode(False)
        recorder.close()
        recorder.close()
    return path


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("recording") / "run.rrd")


def chunks(path: Path, entity: str) -> list:
    return rr.chunk.RrdReader(path).stream().filter(content=entity).to_chunks()


def rows_of(path: Path, entity: str, *, static: bool = False) -> int:
    return sum(chunk.num_rows for chunk in chunks(path, entity) if chunk.is_static == static)


def by_step(path: Path, entity: str, component: str) -> dict[int, Any]:
    """The rows of a component that has one value in each, by the steps at which they were recorded, in their order."""
    rows: dict[int, Any] = {}
    for chunk in chunks(path, entity):
        batch = chunk.to_record_batch()
        if component in batch.schema.names and not chunk.is_static:
            steps, cells = batch.column("step").to_pylist(), batch.column(component).to_pylist()
            rows |= {step: one for step, (one,) in zip(steps, cells, strict=True)}
    return dict(sorted(rows.items()))


def values(path: Path, entity: str, component: str) -> np.ndarray:
    """These rows as numbers, shape (rows, ...)."""
    return np.array(list(by_step(path, entity, component).values()), np.float64)


def test_the_tree_is_there_and_nothing_is_dropped(recording: Path) -> None:
    cam = "/world/drone/1/cam"
    expected = {
        "/world/trail/1": 20,
        f"{cam}/depth/raw": 5,
        "/world/cloud/1": 5,
        "/drone/1/clearance_m": 20,
        "/world/map/1": 5,
        f"{cam}/colors/error": 5,
        f"{cam}/gray_right": 5,
        "/drone/1/error_m/raw": 10,
        "/drone/1/error_m/corrected": 10,
        "/drone/1/holes/corrected": 10,
        "/world/command/1": 20,
        "/world/slot/1": 20,
        "/world/believed/1": 10,
        "/world/path/1": 10,
        "/metrics/formation_error_m": 20,
        "/events": 1,
    }
    assert {entity: rows_of(recording, entity) for entity in expected} == expected
    assert min(by_step(recording, f"{cam}/depth/raw", "EncodedDepthImage:blob")) == 0, "the first image is among them"
    for entity in ("/world", "/world/scene/ground", "/world/drone/1/body", "/drone/0/state"):
        assert rows_of(recording, entity, static=True) == 1
    bodies = {str(chunk.entity_path) for chunk in chunks(recording, "/world/scene/**")}
    scene = load_run("city", 0, {}).scenario.scene.build(0)
    assert bodies == {f"/world/scene/{body.name}" for body in scene.bodies}
    assert rows_of(recording, "/configuration", static=True) == 1
    timelines = {name for chunk in chunks(recording, "/metrics/clearance_m") for name in chunk.timeline_names}
    assert timelines == {"step", "sim_time"}


def test_a_flight_that_raises_an_error_loses_nothing_of_its_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was received is written, however slow that is."""
    run, recorder = planned(tmp_path / "run.rrd")
    add_tick = MissionRecorder._at
    monkeypatch.setattr(MissionRecorder, "_at", lambda self, *at: (sleep(0.02), add_tick(self, *at)))
    with pytest.raises(RuntimeError), closing(recorder), flying(run, recorder, recorded=True) as mission:
        for _ in range(7):
            mission.tick(wait=False)
        raise RuntimeError("the corrector broke")
    assert rows_of(tmp_path / "run.rrd", "/metrics/clearance_m") == 7
    assert rows_of(tmp_path / "run.rrd", "/world/drone/1") == 7


@pytest.mark.parametrize("drone", [0, 1, None])
def test_a_recording_opens_at_the_first_contact(tmp_path: Path, drone: int | None) -> None:
    run, recorder = planned(tmp_path / "run.rrd")
    with flying(run, recorder, recorded=True) as mission:
        mission.tick()
        for other in ("tower-1-2", "later") if drone is not None else ():
            hit = Contact(time_s=4.0, drone=drone or 0, other=other, kind="building", speed_m_s=1.0)
            recorder.contact(mission.world.steps, hit)
    recorder.close()
    reader = rr.chunk.RrdReader(tmp_path / "run.rrd")
    layouts = [chunk for store in reader.blueprints() for chunk in reader.stream(store=store).to_chunks()]
    text = str([chunk.to_record_batch().to_pydict() for chunk in layouts])
    names = [f"{role} hits tower-1-2" for role in ("leader 0", "drone 1")]
    assert [name in text for name in names] == [drone == 0, drone == 1]
    assert (str({"min": 1_000_000_000, "max": 5_000_000_000}) in text) == (drone is not None)


def test_a_second_episode_needs_a_recorder_of_its_own(tmp_path: Path) -> None:
    _, recorder = planned(tmp_path / "run.rrd")
    with closing(recorder), closing(LeaderFollowerEnv(recorder=recorder, **quick())) as env:
        env.reset(seed=0)
        with pytest.raises(ScenarioError, match=r"run\.rrd is of an earlier flight"):
            env.reset(seed=1)


@pytest.mark.parametrize("method", METHODS_OF_THE_PAPER)
def test_a_flight_by_the_paper_s_method_holds_its_stages(tmp_path: Path, method: str) -> None:
    quick = {"name": method, "config": {"window_frames": 2, "fusion_lag_frames": 1}}
    path = recorded(tmp_path / "run.rrd", corrector=quick)
    epochs = int(values(path, "/drone/1/corrector/epoch", "Scalars:scalars").max())
    assert epochs >= 1
    for entity in ("/world/voxels/1", "/world/drone/1/cam/depth/template", "/world/drone/1/cam/colors/template"):
        assert rows_of(path, entity) == epochs
    cam, seen = "/world/drone/1/cam", set()
    raw_pngs = by_step(path, f"{cam}/depth/raw", "EncodedDepthImage:blob")
    for step, labels in by_step(path, f"{cam}/source", "SegmentationImage:buffer").items():
        raw_m = cv2.imdecode(np.array(raw_pngs[step], np.uint8), cv2.IMREAD_UNCHANGED)
        source = np.array(labels, np.uint8).reshape(raw_m.shape)
        assert (raw_m[source == Source.MEMORY] == 0).all()
        assert (raw_m[source == REPLACED] > 0).all()
        seen |= set(np.unique(source))
    assert {Source.SENSOR, Source.MEMORY} <= seen
    assert (REPLACED in seen) == (method == PAPER), "the code of the authors replaces no measurement"
    if method == AUTHORS:
        return  # Drone 0 has no epoch within a second.
    promised = promised_entities("run.rrd")
    assert [entity for entity in promised if not rows_of(path, f"/{entity}")] == []


def test_with_several_swarms_the_first_is_followed(tmp_path: Path) -> None:
    routes = [{"start_m": [-8.0, y, 6.0], "goal_m": [9.0, y, 6.0]} for y in (0.0, 50.0)]
    path = recorded(tmp_path / "run.rrd", **{"mission.drones": 1, "mission.routes": routes, "mission.duration_s": 0.1})
    first_m, followed_m = (values(path, f"/world/{of}", "Transform3D:translation") for of in ("drone/0", "swarm"))
    np.testing.assert_allclose(followed_m, first_m, atol=1e-5)


def test_the_view_follows_the_middle_of_the_drones_and_trails_are_their_ways(recording: Path) -> None:
    drones_m = np.array([values(recording, f"/world/drone/{i}", "Transform3D:translation") for i in range(2)])
    np.testing.assert_allclose(
        values(recording, "/world/swarm", "Transform3D:translation"), drones_m.mean(axis=0), atol=1e-5
    )
    np.testing.assert_allclose(values(recording, "/world/trail/1", "Points3D:positions"), drones_m[1], atol=1e-5)


def test_the_error_and_the_holes_of_one_image_are_those_of_the_metrics(tmp_path: Path) -> None:
    run, recorder = planned(tmp_path / "run.rrd", **{"mission.drones": 1, "mission.duration_s": 0.05})
    with closing(recorder), flying(run, recorder, recorded=True) as mission:
        result = mission.run()
    for depth in ("raw", "corrected"):
        (error_m,), (holes,) = (
            values(tmp_path / "run.rrd", f"/drone/0/{curve}/{depth}", "Scalars:scalars")
            for curve in ("error_m", "holes")
        )
        assert error_m == pytest.approx(result.metrics[f"depth_{depth}_mae_m"])
        assert holes == pytest.approx(result.metrics[f"depth_{depth}_hole_share"])


def test_a_slot_keeps_its_place_behind_the_leader_and_a_drone_believes_its_drifted_pose(recording: Path) -> None:
    leader_m = values(recording, "/world/drone/0", "Transform3D:translation")
    slots_m = values(recording, "/world/slot/1", "Points3D:positions").reshape(-1, 3)
    np.testing.assert_allclose(slots_m - leader_m, np.broadcast_to(slots_m[0] - leader_m[0], slots_m.shape), atol=1e-5)
    believed = by_step(recording, "/world/believed/1", "Points3D:positions")
    true = by_step(recording, "/world/drone/1", "Transform3D:translation")
    apart_m = [np.linalg.norm(np.subtract(believed[step], true[step])) for step in believed]
    assert max(apart_m) < 0.3
    assert apart_m[-1] > apart_m[0]


def test_a_drone_is_marked_on_its_map_where_it_is_in_the_world(recording: Path) -> None:
    """The camera that looks down on the world sees the drone, and what is before it, where the arrow is."""
    path = "/world/map/1"
    K = values(recording, path, "Pinhole:image_from_camera").reshape(-1, 3, 3).swapaxes(1, 2)
    R = values(recording, path, "Transform3D:mat3x3").reshape(-1, 3, 3).swapaxes(1, 2)
    above_m = values(recording, path, "Transform3D:translation")
    at_px = values(recording, f"{path}/drone", "Arrows2D:origins")
    ahead_px = values(recording, f"{path}/drone", "Arrows2D:vectors")
    drone, mapped = "/world/drone/1", by_step(recording, path, "Pinhole:image_from_camera")
    position_m, q = (by_step(recording, drone, f"Transform3D:{name}") for name in ("translation", "quaternion"))
    at_m = np.array([position_m[step] for step in mapped])
    ahead = [rotation_from_quaternion(np.array(q[step]))[:, 0] for step in mapped]
    assert len(K) == len(at_m) == 5
    for i in range(5):
        for point_m, px in ((at_m[i], at_px[i]), (at_m[i] + HEADING_M * ahead[i], at_px[i] + ahead_px[i])):
            x, y, z = K[i] @ R[i].T @ (np.array([*point_m[:2], above_m[i, 2] - 1.0]) - above_m[i])
            assert z == pytest.approx(1.0)
            np.testing.assert_allclose([x, y], px, atol=0.05)


def test_a_map_is_seen_from_above_with_its_left_on_the_left(tmp_path: Path) -> None:
    run, recorder = planned(tmp_path / "run.rrd")
    views = {}
    with closing(recorder), flying(run, recorder, recorded=True) as mission:
        tick = recorder.tick
        recorder.tick = lambda step, *more: (views.update({step: more[2][1].view}), tick(step, *more))
        while mission.time_s < 0.5:
            mission.tick()
    for step, labels in by_step(tmp_path / "run.rrd", "/world/map/1", "SegmentationImage:buffer").items():
        np.testing.assert_array_equal(np.reshape(labels, views[step].state.shape), views[step].state[::-1])


def test_what_is_recorded_is_written_in_the_order_of_time(tmp_path: Path) -> None:
    """A viewer that loads the file sees the first seconds first, and a run that is killed leaves all but the last."""
    quick = {"rig.depth": "truth", "corrector": "raw", "mission.drones": 1, **images_of(32, 32)}
    path = recorded(tmp_path / "run.rrd", **{**quick, "mission.duration_s": 5.0})
    spans_s = [
        (min(times_s), max(times_s))
        for chunk in rr.chunk.RrdReader(path).stream().to_chunks()
        if not chunk.is_static and "sim_time" in chunk.timeline_names
        for times_s in [[t.total_seconds() for t in chunk.to_record_batch().column("sim_time").to_pylist()]]
    ]
    assert max(last - first for first, last in spans_s) <= CHUNK_S
    for (_, before), (first, _) in pairwise(spans_s):
        assert first > before - CHUNK_S - 0.1
    assert len({first // CHUNK_S for first, _ in spans_s}) == 3


def test_points_of_the_cloud_lie_on_the_bodies_that_the_camera_measured() -> None:
    run = load_run("city", 0, {"mission.drones": 1, "rig.depth": "truth", "corrector": "raw", **images_of(96, 54)})
    recorder = CaptureRecorder()
    with flying(run, recorder, recorded=True) as mission:
        mission.tick()
        points_m, source = cloud(*recorder.newest[0])
        away_m = np.array([mission.world.clearance_at_m(point_m) for point_m in points_m.tolist()])
    assert len(points_m) == len(source) > 100
    assert np.percentile(np.abs(away_m), 95) < 0.1


def test_depth_survives_the_recording_within_two_percent_and_is_the_largest_beyond_16_bits() -> None:
    depth = np.array([[0.0, 0.5, 3.3, 12.0, 40.0, 700.0, 5000.0]], np.float32)
    stored = cv2.imdecode(np.frombuffer(depth_png(depth), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_allclose(stored / 100, np.minimum(depth, 655.35), rtol=0.02)
    assert (stored[0, [0, -2, -1]] == [0, 65535, 65535]).all()


def test_the_recorded_camera_counts_pixels_from_their_corner(recording: Path) -> None:
    camera = load_run("city", 0, images_of(96, 54)).scenario.rig.intrinsics
    (chunk,) = (one for one in chunks(recording, "/world/drone/0/cam") if one.is_static)
    (K,) = chunk.to_record_batch().column("Pinhole:image_from_camera").to_pylist()
    np.testing.assert_allclose(np.reshape(K, (3, 3))[2, :2], [camera.cx_px + 0.5, camera.cy_px + 0.5])
