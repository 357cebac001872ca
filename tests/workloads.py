"""Workloads: all that the project computes, on a small scale, by name.

Sensors, correctors, references of evaluations, flights, recordings, studies and learners. A workload returns a value
that is made of numbers, texts and arrays. `tests/kept.py` compares the values of two revisions of the code, and
`tests/portable.py` those of one revision under different features of the processor.
"""

import hashlib
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, fields, replace
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr

from scenarios.config import load_run
from scenarios.evaluation import SimulatedSource
from scenarios.files import shipped_names
from scenarios.flight import fly
from scenarios.report import summary_tables
from scenarios.runner import fly_and_write
from scenarios.sequences import load_sequence, record, simulation
from scenarios.study.design import expand
from scenarios.study.diagnose import CollisionProbe
from scenarios.study.executors import run_one
from scenarios.study.report import StudyAnalysis
from scenarios.study.store import StudyData
from sim.recording import Recording
from sim.types import Capture
from swarm.environments.gym_env import LeaderFollowerEnv
from swarm.perception import frame_of
from swarm.recorder import Recorder
from tests.learning import quick
from tests.studies import arm, flown, noisy, study
from tests.temporal_scenes import CAMERA, OTHER_ROOM, ROOM, dark, walk
from tests.temporal_scenes import frame_of as frame_at
from tests.temporal_scenes import noisy as noisy_frame
from voxdepth.corrector_spec import CorrectorSpec
from voxdepth.datasets import open_dataset
from voxdepth.registry import BUILTIN_NAMES
from voxdepth.tools.evaluation.methods import find_method, run
from voxdepth.tools.evaluation.recordings import RecordedSource, kinds_of
from voxdepth.types import Frame, Intrinsics

SMALL = {"rig.width_px": 128, "rig.height_px": 96}
MOVING = {"rig.exposure_sigma": 0.1, "flight": {"kind": "walk", "speed_m_s": 1.0}}
"""A camera that moves, and whose brightness varies."""
SENSORS: Mapping[str, dict[str, Any]] = {
    "fitted": {"rig.depth": "fitted"},
    "truth": {"rig.depth": "truth"},
    "dim": {"rig.light_stops": -2.0, "rig.exposure_sigma": 0.3, "rig.exposure_settling_frames": 2.0},
    "projected": {"rig.projected_texture": 0.8, "rig.stereo.min_texture": 0.0},
    "noise of a colour camera": {
        "rig.depth": "noisy",
        "rig.color_offset_m": 0.015,
        "rig.noise.disparity.sigma_px": 0.2,
    },
    "raster": {"renderer": "raster"},
    "tiny": {"renderer": "tiny"},
}
"""Changes of the sequence `sim-MB` that no shipped sequence has."""
CORRECTORS = (
    *BUILTIN_NAMES,
    "temporal[decimation=2]",
    "temporal[fill=all,smoothing_window_px=3]",
    "temporal[fill=none,shadow_factor=1]",
    "voxdepth[window_frames=2,fusion_lag_frames=1,max_epoch_frames=4]",
    "voxdepth[window_frames=2,fusion_lag_frames=0,chained=true,only_empty=true]",
)
CRASH = {"mission.controller": "examples.straight_controller:create", "mission.cruise_speed_m_s": 4.0}
"""The leader hits the first pillar."""
JUDGED = (None, "shadows", "wide-shadows", "patches")
"""What pixels methods are evaluated on; None for all, by the truth."""
ODD = replace(CAMERA, width_px=161, height_px=121)
"""A camera whose last row and column have no working pixel at half resolution."""
FLIGHTS: Mapping[str, tuple[str, dict[str, Any]]] = {
    **{name: (name, {}) for name in shipped_names("scenarios")},
    "drift": ("pillars", {"mission.pose_prior.kind": "drift", "mission.link.loss": 0.3}),
    "free holes": ("city", {"corrector": "raw", "mission.pilot.holes": "free", "mission.drones": 3}),
    "arrival": ("pillars", {"corrector": "raw", "rig.depth": "truth", "mission.duration_s": 20.0}),
    "crash": ("pillars", CRASH | {"mission.after_contact": "drop"}),
}
RECORDED = {"mission.duration_s": 1.5, "mission.drones": 2}
FLOWN = {"rig.width_px": 96, "rig.height_px": 64, "rig.decimate": 1, "mission.duration_s": 10.0, "mission.drones": 3}


def captures(name: str, frames: int, **changes: Any) -> Iterator[Capture]:
    """The first captures of a shipped sequence with changes, small."""
    with simulation(load_sequence(name, 1, SMALL | changes)) as simulated:
        yield from (simulated.sensor.capture(pair) for pair in simulated.render(frames))


def sensor(name: str, **changes: Any) -> Capture:
    """What a camera gives."""
    return list(captures(name, 2, **changes))[-1]


@cache
def _clip() -> list[Capture]:
    """A sphere crosses the view of a camera with noise and wrong pixels, before walls."""
    return list(captures("sim-cross", 30, renderer="raster", **MOVING))


def corrector(text: str) -> Any:
    """What a corrector makes of a clip, after a frame, and at its end."""
    return _corrected(text, _clip()[0].intrinsics, [frame_of(capture) for capture in _clip()])


def stream(text: str, camera: Intrinsics = CAMERA, *, has_poses: bool = False) -> Any:
    """What a corrector makes of a camera that is covered, sees another room, and comes back."""
    there = walk(10, step_m=0.04, yaw_deg=2.0)
    rooms = [ROOM] * 10 + [OTHER_ROOM] * 5 + [ROOM] * 10
    poses = [*there, *there[:5], *reversed(there)]
    frames = [
        noisy_frame(frame_at(room, T, k, camera), 3, camera=camera)
        for k, (room, T) in enumerate(zip(rooms, poses, strict=True))
    ]
    frames[5:7] = dark(5, camera), dark(6, camera)
    if has_poses:
        frames = [replace(frame, T_world_cam=T) for frame, T in zip(frames, poses, strict=True)]
    return _corrected(text, camera, frames)


def _corrected(text: str, intrinsics: Intrinsics, frames: Sequence[Frame]) -> Any:
    method = CorrectorSpec.model_validate(text).create(intrinsics)
    results = [method.process(frame) for frame in frames]
    means = np.array([[r.depth_m.mean(), r.source.mean(), r.confidence.mean()] for r in results])
    facts = [r.diagnostics.facts() for r in results[1::4] if r.diagnostics is not None]
    return {"second": results[1], "last": results[-1], "means": means, "facts": facts}


class Watch(Recorder):
    """Keeps what the drones decide and see."""

    def __init__(self) -> None:
        self.states: Counter[str] = Counter()
        self.commands: list[np.ndarray] = []
        self.depths: list[np.ndarray] = []
        self.digest = hashlib.sha256()
        """Of every pixel of every corrected depth."""

    def tick(self, step: int, time_s: float, states: Any, decisions: Any) -> None:
        self.states.update(decision.state for decision in decisions)
        self.commands.append(np.array([[*d.command.velocity_m_s, d.command.yaw_rad] for d in decisions]))

    def capture(self, step: int, capture: Any, corrected: Any) -> None:
        self.depths.append(np.array([corrected.depth_m.mean(), corrected.confidence.mean()]))
        self.digest.update(corrected.depth_m.tobytes())


def flight(name: str, **changes: Any) -> Any:
    """How a mission goes, and what the drones see and decide."""
    watch = Watch()
    planned = load_run(name, 1, FLOWN | changes)
    finished = fly(planned, recorder=watch, threads=1)
    seen = {
        "commands": np.concatenate(watch.commands),
        "depths": np.array(watch.depths),
        "pixels": watch.digest.hexdigest(),
    }
    tables = [table.markdown() for table in summary_tables(finished, planned)]
    return {"result": finished.result, "states": watch.states, **seen, "tables": tables}


def recording(name: str) -> Any:
    """The components of the entities in the Rerun recording of a flight, but for its times and its second drone."""
    columns: defaultdict[str, list[pa.Array]] = defaultdict(list)
    with TemporaryDirectory() as folder:
        written = fly_and_write(load_run(name, 1, FLOWN | RECORDED), Path(folder), record=True).folder
        assert written is not None
        for chunk in rr.chunk.RrdReader(written / "run.rrd").stream().to_chunks():
            batch = chunk.to_record_batch()
            for column in batch.schema.names:
                if ":" in column and "/1" not in chunk.entity_path:
                    columns[f"{chunk.entity_path} {column}"].append(batch.column(column))
    return {column: _values(parts) for column, parts in columns.items()}


def _values(parts: list[pa.Array]) -> Any:
    values = pa.concat_arrays(parts)
    while pa.types.is_list(values.type) or pa.types.is_fixed_size_list(values.type):
        values = values.flatten()
    is_number = pa.types.is_integer(values.type) or pa.types.is_floating(values.type)
    return values.to_numpy(zero_copy_only=False) if is_number else str(values.to_pylist())


def diagnosis() -> Any:
    """What is found about the collision of a drone."""
    planned = load_run("pillars", 1, FLOWN | CRASH)
    probe = CollisionProbe(planned.scenario.mission.pilot)
    fly(planned, recorder=probe, threads=1)
    return probe.diagnoses


def references(hidden: str | None) -> Any:
    """What methods are evaluated on in a recording, and how two of them compare; None for the truth."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "clip"
        record(load_sequence("sim-cross", 1, SMALL | MOVING | {"renderer": "raster"}), path, 12, lambda done: None)
        if hidden is None:
            source: Any = SimulatedSource("clip", Recording.open(path), 1)
        else:
            source = RecordedSource("clip", open_dataset(path), kinds_of(path, open_dataset)[hidden])
        frames = list(source.frames(6))
        methods = [find_method(name) for name in ("ip-basic", "temporal")]
        scores = [run(method, frames, source.reference, source.intrinsics, 0).measurements for method in methods]
    steady = [[(*one[:4], one.value) for one in own if "ms" not in one.unit] for own in scores]
    images = [{one.name: getattr(frame, one.name) for one in fields(frame) if one.name != "frame"} for frame in frames]
    return {"images": images[-1], "scores": steady}


def report(contents: Callable[[], StudyData]) -> Any:
    """The sentences and the tables of the report of a study."""
    findings = StudyAnalysis(contents())
    return {"verdict": findings.verdict, **{name: table.markdown() for name, table in findings.tables.items()}}


def _of_three() -> StudyData:
    declared = {"arm": "b", "against": "a", "endpoint": "arrived"}
    outcomes = {("city", "a"): "ooxsxoxt", ("city", "b"): "oooootos", ("city", "c"): "xxox lxt"}
    return flown(study(arm("a"), arm("b"), arm("c"), seeds=8, declared=declared), outcomes)


def _of_levels() -> StudyData:
    planned = study(noisy("a", 0.1, 0.5, 1.0), noisy("b", 0.1, 0.5, 1.0), seeds=4)
    return flown(planned, {("city", "a"): "oxxs", ("city", "b"): "ooxt"})


def flown_study() -> Any:
    """The records of a small study that is flown."""
    planned = study(arm("seen", depth="stereo", corrector="temporal"), noisy("noise", 0.5, 1.0), seeds=2)
    records = [run_one(spec) for spec in expand(planned)]
    return [{key: part for key, part in asdict(one).items() if key != "wall_s"} for one in records]


def learner(**options: Any) -> Any:
    """What a learner sees and is rewarded by."""
    env = LeaderFollowerEnv(**quick(y_m=1.0) | options)
    steps = [env.reset(seed=3)]
    actions = [[1.0, 0.2, 0.0, 0.3], [0.5, -0.4, 0.2, -0.5]]
    steps += [env.step(np.array(actions[k % 2], np.float32)) for k in range(8)]
    env.close()
    return steps[::4]


WORKLOADS: Mapping[str, Callable[[], Any]] = {
    **{f"sequence {name}": partial(sensor, name) for name in shipped_names("sequences")},
    **{f"sensor {name}": partial(sensor, "sim-MB", **own) for name, own in SENSORS.items()},
    **{f"corrector {text}": partial(corrector, text) for text in CORRECTORS},
    **{
        f"stream of {text}{', with poses' * has_poses}": partial(stream, text, has_poses=has_poses)
        for text in (*CORRECTORS[-5:-2], "voxdepth[window_frames=3,fusion_lag_frames=1]")
        for has_poses in (False, True)
    },
    "stream of odd images": partial(stream, "temporal[decimation=2]", ODD),
    **{f"flight {name}": partial(flight, of, **own) for name, (of, own) in FLIGHTS.items()},
    **{f"judged by {name or 'truth'}": partial(references, name) for name in JUDGED},
    **{f"recording of {name}": partial(recording, name) for name in ("paper", "moving")},
    "diagnosis of a crash": diagnosis,
    "study": flown_study,
    "report of three arms": partial(report, _of_three),
    "report of levels": partial(report, _of_levels),
    "learner in metres": learner,
    "learner by nearness": partial(learner, observation="nearness", corrector="median", others="blind"),
}
