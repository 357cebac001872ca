"""What a recording holds."""

from pathlib import Path

import numpy as np
import rerun as rr

from scenarios.config import images_of, load_run
from scenarios.rerun.mission import MissionRecorder
from scenarios.rerun.stream import depth_png
from scenarios.runner import flying


def chunks(path: Path, entity: str) -> list:
    return rr.chunk.RrdReader(path).stream().filter(content=entity).to_chunks()


def test_the_tree_is_there_and_nothing_is_dropped(tmp_path: Path) -> None:
    changes = {"mission.drones": 2, "mission.duration_s": 1.0, **images_of(96, 64)}
    run = load_run("city", 0, changes)
    path = tmp_path / "run.rrd"
    recorder = MissionRecorder(path, run.scenario.rig, recording_id="test", image_every=2)
    rr.set_strict_mode(True)
    try:
        with flying(run, recorder, recorded=True) as mission:
            mission.run()
    finally:
        rr.set_strict_mode(False)
        recorder.close()
        recorder.close()
    cam, fixed = "/world/drone/1/cam", ("/world", "/world/scene")
    rows = {
        "/world": 1,
        "/world/scene": 1,
        "/world/drone/0": 20,
        "/world/slots": 20,
        f"{cam}/gray": 5,
        f"{cam}/depth/true": 5,
        f"{cam}/depth/raw": 5,
        f"{cam}/depth/corrected": 5,
        "/world/drone/1/histogram": 10,
        "/metrics/clearance_m": 20,
        "/metrics/formation_error_m": 20,
        "/events": 1,
    }
    found = {
        entity: sum(chunk.num_rows for chunk in chunks(path, entity) if chunk.is_static == (entity in fixed))
        for entity in rows
    }
    assert found == rows
    assert chunks(path, "/drone/0/state")
    timelines = {name for chunk in chunks(path, "/metrics/clearance_m") for name in chunk.timeline_names}
    assert timelines == {"step", "sim_time"}


def test_depth_survives_the_recording_within_two_percent() -> None:
    import cv2

    depth = np.array([[0.0, 0.5, 3.3, 12.0, 40.0]], np.float32)
    stored = cv2.imdecode(np.frombuffer(depth_png(depth), np.uint8), cv2.IMREAD_UNCHANGED) / 100
    np.testing.assert_allclose(stored, depth, rtol=0.02)
    assert stored[0, 0] == 0
