"""Recordings of missions: world, drones, images, maps, states, metrics and events."""

from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import rerun as rr
import rerun.blueprint as rrb

from sim.bodies import Body
from sim.frames import R_BODY_CAM, pose, quaternion_from_yaw, rotation_from_quaternion, rotation_from_yaw
from sim.render.meshes import mesh_of_shape, moved, normals
from sim.types import Capture, Contact, DroneState
from sim.world import DRONE_BODY_HEIGHT_M, World
from swarm.map.voxel_map import STATES, VOXEL_M
from swarm.metrics import EVALUATED_RANGE_M
from swarm.mission import DROPPED, contact_text
from swarm.pilot import Decision
from swarm.recorder import Recorder
from swarm.team import Team
from swarm.types import MapView, Outcome
from voxdepth.arithmetic import length
from voxdepth.colors import FAR_M
from voxdepth.geometry import back_project, transform
from voxdepth.metrics import depth_errors
from voxdepth.registry import METHODS_OF_THE_PAPER
from voxdepth.tools.files import as_tool_error, to_toml
from voxdepth.tools.stream import (
    RecordingFile,
    finite,
    jpeg,
    labels_of,
    layout,
    log_depth,
    log_error,
    log_frame,
    log_warped,
    new_template,
    source_labels,
    voxel_cloud,
)
from voxdepth.types import CorrectedDepth, FloatArray

from ..config import Run
from ..errors import ScenarioError
from ..images import drone_color
from .background import Background, in_background
from .columns import ColumnWriter

CHUNK_S = 2.0
"""Simulated time after which everything is written to the file: a run that is killed loses no more of its recording."""
AROUND_CONTACT_S = (-3.0, 1.0)
"""The seconds around the first contact that a recording shows first."""
CONTACT_COLOR = (230, 20, 20)
CLOUD_STEP_PX = 4
"""Every n-th pixel of every n-th row of the corrected depth is a point of the cloud."""
SHARED_VIEWS = ("cam/depth", "cam/colors", "cam/source", "cam/confidence")
"""Images of a drone that the view of the world leaves out."""
STATE_COLORS = {
    "free": (120, 180, 120),
    "avoiding": (90, 150, 220),
    "exploring": (230, 190, 70),
    "blocked": (225, 110, 50),
    "unguarded": (150, 110, 180),
    "waiting": (150, 150, 150),
    "collided": (210, 30, 30),
    "dropped out": (60, 60, 60),
}
"""Colours of the states of a drone."""
CURVES = {"clearance_m": "clearance [m]", "speed_m_s": "speed [m/s]"}
"""Curves of every drone, and their names."""
ERROR_CURVES = {"error_m": "mean error of depth within 20 m [m]", "holes": "share of it without depth"}
"""Curves of the depth of every drone, as measured and as corrected, and their names."""
ERROR_COLORS = {"raw": (200, 90, 60), "corrected": (60, 150, 220)}
CHOICE_M, CHOICE_COLOR = 1.5, (240, 230, 80)
"""Length and colour of the arrow of a chosen direction; a planned way has the same colour."""
COMMAND_COLOR, BELIEVED_COLOR = (250, 250, 250), (160, 160, 160)
"""Colours of a commanded velocity, and of the position where a drone believes that it is."""
NO_LEGEND = rrb.PlotLegend(visible=False)
EVENT_COLUMNS = rrb.archetypes.TextLogColumns(text_log_columns=[rrb.components.TextLogColumn("Body")])
"""Columns of the list of events beside the time: the rest would hide what happened."""
OPACITY = 110
"""Opacity of bodies, of at most 255."""
EYE_M = (-13.0, -4.0, 24.0)
"""Where the world is seen from, relative to the middle of the first swarm."""
BELOW_M = 1.5
"""Distance below a drone at which its map is drawn."""
MAP_EDGE = (140, 140, 150)
HEADING_M = 2.0
"""Length of the arrow that marks a drone on its map."""


CELL_COLORS = ((225, 235, 225), (140, 140, 150), (230, 140, 50), (150, 70, 20), (40, 40, 40))
"""Colours of the cells of a map by state, in the order of `STATES`."""


class MissionRecorder(Recorder):
    """Writes one `.rrd` file of one flight, with a blueprint; a second flight is a `ScenarioError`.

    The file is created when the mission starts. The same run gives the same data, without wall-clock times, and runs of
    the same scenario and seed have the same id, so that they can be compared.

    What is received is written in a thread, while the flight goes on; an error of it is raised by a later call. `close`
    waits until everything is written, also after a flight that raised an error.
    """

    def __init__(self, path: Path, run: Run) -> None:
        self._path = path
        self._run = run
        self._has_stages = run.scenario.corrector.name in METHODS_OF_THE_PAPER
        """Whether the correctors are the paper's method, whose stages the layout shows."""
        self._seen: Counter[str] = Counter()
        """How often something was there that is recorded every n-th time."""
        self._views: dict[int, MapView] = {}
        """Newest view of each drone."""
        self._states: dict[str, str] = {}
        """Newest state of each entity that has states."""
        self._camera_poses: dict[tuple[int, float], FloatArray] = {}
        """Pose of the camera of each capture, by drone and time: a template has the pose of an earlier one."""
        self._newest_m: Sequence[FloatArray] = ()
        """Position of each drone at the last decision."""
        self._contacts = 0
        self._written_s = 0.0
        self._file: RecordingFile | None = None
        self._is_used = False

    def start(self, world: World, teams: Sequence[Team]) -> None:
        """Open the file and record everything that does not move."""
        if self._is_used:
            raise ScenarioError(f"{self._path} is of an earlier flight: give every flight a recorder and a path")
        self._is_used = True
        self._world, self._leaders, self._teams = world, {team.leader for team in teams}, teams
        self._followed = teams[0].members
        # Chunks end by size and by simulated time: ending them by the clock would make two runs differ.
        batching = rr.ChunkBatcherConfig(flush_tick=3600.0, flush_num_bytes=1 << 20, flush_num_rows=1 << 14)
        views = blueprint(world.n_drones, self._leaders, self._has_stages)
        scenario = self._run.scenario
        recording_id = f"{scenario.name}-{self._run.seed}-{scenario.rig.depth}-{scenario.corrector}"
        with as_tool_error(f"cannot write {self._path}"):
            self._file = RecordingFile("voxdepth", self._path, recording_id, views, batcher_config=batching)
        self._stream, self.background = self._file.stream, Background()
        self._stream.send_recording_name(self._run.title)
        self._columns = ColumnWriter(self._stream)
        self._log_static("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        self._log_static("configuration", rr.TextDocument(to_toml(self._run)))
        cells = [(index, *cell) for index, cell in enumerate(zip(STATES, CELL_COLORS, strict=True))]
        self._log_static("world/map", rr.AnnotationContext(cells))
        self._log_static("world/cloud", source_labels())
        for body in world.scene.bodies:
            self._log_body(f"world/scene/{body.name}", body)
        for index, mover in enumerate(world.scene.movers):
            self._log_body(f"world/mover/{index}", replace(mover.body, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0))
        goals_m = [team.goal_m for team in teams]
        goals = rr.Points3D(goals_m, radii=[0.6], colors=[(80, 220, 100)], labels=["goal"] * len(goals_m))
        self._log_static("world/goal", goals)
        for drone in range(world.n_drones):
            self._log_camera(drone)
            self._log_looks(drone)

    def tick(self, step: int, time_s: float, states: Sequence[DroneState], decisions: Sequence[Decision]) -> None:
        """Record poses, velocities, clearances and changes of state."""
        clearances_m = [
            None if decision is DROPPED else self._world.clearance_m(drone) for drone, decision in enumerate(decisions)
        ]
        self._add_tick(step, time_s, states, decisions, clearances_m, self._world.movers_now())

    @in_background
    def _add_tick(
        self,
        step: int,
        time_s: float,
        states: Sequence[DroneState],
        decisions: Sequence[Decision],
        clearances_m: Sequence[float | None],
        movers: Sequence[Body],
    ) -> None:
        self._at(step, time_s)
        self._newest_m = [state.position_m for state in states]
        for drone, (state, decision) in enumerate(zip(states, decisions, strict=True)):
            self._add_drone(drone, state, decision, clearances_m[drone])
        for team in self._teams:
            slots_m = self._newest_m[team.leader] + team.offsets_m[1:]
            for drone, slot_m in zip(team.members[1:], slots_m, strict=True):
                self._columns.add(f"world/slot/{drone}", rr.Points3D, positions=[slot_m])
        flying_m = [states[drone].position_m for drone in self._followed if decisions[drone] is not DROPPED]
        if flying_m:
            self._columns.add("world/swarm", rr.Transform3D, translation=[np.mean(flying_m, axis=0)])
        for index, body in enumerate(movers):
            self._add_pose(f"world/mover/{index}", body.position_m, quaternion_from_yaw(body.yaw_rad))

    def _add_drone(self, drone: int, state: DroneState, decision: Decision, clearance_m: float | None) -> None:
        """Record where a drone is, how it flies, and what it has decided; without a clearance it has dropped out."""
        self._add_pose(f"world/drone/{drone}", state.position_m, state.q_world_body_xyzw)
        self._add_arrow(f"world/velocity/{drone}", state.position_m, state.velocity_m_s)
        self._columns.add(f"world/trail/{drone}", rr.Points3D, positions=[state.position_m])
        if clearance_m is not None:
            self._add_number(f"drone/{drone}/clearance_m", clearance_m)
            self._add_number(f"drone/{drone}/speed_m_s", length(state.velocity_m_s))
        self._add_arrow(f"world/command/{drone}", state.position_m, decision.command.velocity_m_s)
        if decision.direction is not None:
            self._add_arrow(f"world/choice/{drone}", state.position_m, CHOICE_M * decision.direction)
        if decision.view is not None and decision.view is not self._views.get(drone):
            self._views[drone] = decision.view
            self._add_odometry(drone, state, decision)
            if self._is_due(f"map {drone}"):
                self._log_map(drone, state, decision.view)
        self._add_state(f"drone/{drone}/state", decision.state)

    @in_background
    def capture(self, step: int, capture: Capture, corrected: CorrectedDepth) -> None:
        """Record what the corrector reports, and the images of some captures."""
        self._at(step, capture.stamp_s)
        self._log_work(capture, corrected)
        if self._is_due(f"capture {capture.drone}"):
            self._log_images(capture, corrected)

    @in_background
    def metrics(self, step: int, time_s: float, values: dict[str, float]) -> None:
        """Record one curve per metric, the last of a tick's data; from time to time write everything to the file."""
        self._at(step, time_s)
        for name, value in values.items():
            self._add_number(f"metrics/{name}", value)
        if time_s >= self._written_s + CHUNK_S and self._file is not None:
            self._written_s = time_s
            self._columns.flush()
            with as_tool_error(f"cannot write {self._path}"):
                self._file.flush()

    @in_background
    def contact(self, step: int, contact: Contact) -> None:
        """Record an event, the new state of the drone, and where it was: a red point that stays."""
        self._at(step, contact.time_s)
        hit = f"{drone_name(contact.drone, self._leaders)} hit {contact.other}"
        mark = rr.Points3D([self._newest_m[contact.drone]], radii=[0.4], colors=[CONTACT_COLOR], labels=[hit])
        self._stream.log(f"world/contact/{self._contacts}", mark)
        if self._contacts == 0:
            self._stream.send_blueprint(blueprint(self._world.n_drones, self._leaders, self._has_stages, contact))
        self._contacts += 1
        self._stream.log("events", rr.TextLog(contact_text(contact), level=rr.TextLogLevel.ERROR))
        self._add_state(f"drone/{contact.drone}/state", "collided")

    @in_background
    def outcome(self, step: int, time_s: float, outcome: Outcome) -> None:
        """Record the last event."""
        self._at(step, time_s)
        level = rr.TextLogLevel.INFO if outcome is Outcome.SUCCESS else rr.TextLogLevel.WARN
        self._stream.log("events", rr.TextLog(f"outcome: {outcome}", level=level))

    def close(self) -> None:
        """Write buffered data and close the file; a second call does nothing, nor one before the start."""
        if self._file is not None:
            with ExitStack() as all_of_it:
                all_of_it.callback(self._close_file)
                self.background.close()

    def _close_file(self) -> None:
        file, self._file = self._file, None
        assert file is not None, "a file that is closed was open"
        self._columns.flush()
        with as_tool_error(f"cannot write {self._path}"):
            file.close()

    def _is_due(self, what: str) -> bool:
        """Count something, and return whether this is the first or another n-th time."""
        self._seen[what] += 1
        return (self._seen[what] - 1) % self._run.scenario.recording.image_every == 0

    def _at(self, step: int, time_s: float) -> None:
        self._stream.set_time("step", sequence=step)
        self._stream.set_time("sim_time", duration=time_s)
        self._columns.set_time(step, time_s)

    def _log_static(self, entity: str, *what: Any) -> None:
        self._stream.log(entity, *what, static=True)

    def _log_image(self, drone: int, name: str, what: Any) -> None:
        """Record an image of the camera of a drone, or what belongs to it."""
        self._stream.log(f"world/drone/{drone}/cam/{name}", what)

    def _add_number(self, entity: str, value: Any) -> None:
        self._columns.add(entity, rr.Scalars, scalars=[float(value)])

    def _add_pose(self, entity: str, position_m: Any, q_xyzw: FloatArray) -> None:
        self._columns.add(entity, rr.Transform3D, translation=[position_m], quaternion=[q_xyzw])

    def _add_arrow(self, entity: str, origin_m: FloatArray, vector: FloatArray) -> None:
        self._columns.add(entity, rr.Arrows3D, origins=[origin_m], vectors=[vector])

    def _add_state(self, entity: str, state: str) -> None:
        """Record a state if it is a new one."""
        if self._states.get(entity) != state:
            self._states[entity] = state
            self._columns.add(entity, rr.StateChange, state=[state])

    def _log_body(self, path: str, body: Body) -> None:
        """Record a body as triangles with a normal each. What is behind it can be seen through it."""
        mesh = moved(mesh_of_shape(body.shape), rotation_from_yaw(body.yaw_rad), np.array(body.position_m))
        corners_m = mesh.vertices_m[mesh.triangles]
        gray = int(255 * body.surface.albedo)
        shown = rr.Mesh3D(
            vertex_positions=corners_m.reshape(-1, 3),
            vertex_normals=np.repeat(normals(mesh), 3, axis=0),
            albedo_factor=(gray, gray, gray, OPACITY),
        )
        self._log_static(path, shown)

    def _log_camera(self, drone: int) -> None:
        """Record intrinsics and mount, once per drone: the camera is fixed to the airframe."""
        rig = self._run.scenario.rig
        i = rig.intrinsics
        pinhole = rr.Pinhole(
            focal_length=[i.fx_px, i.fy_px],
            principal_point=[i.cx_px + 0.5, i.cy_px + 0.5],
            resolution=[i.width_px, i.height_px],
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=0.8,
        )
        mount = rr.Transform3D(translation=rig.left_mount_m, mat3x3=R_BODY_CAM)
        # One row, since the order of several chunks of one entity in the file is random.
        self._log_static(f"world/drone/{drone}/cam", pinhole, mount, source_labels())

    def _log_looks(self, drone: int) -> None:
        """Record the body of a drone and the colours of what belongs to it, once per drone."""
        name, color = drone_name(drone, self._leaders), drone_color(drone)
        size: dict[str, Any] = {"lengths": [DRONE_BODY_HEIGHT_M], "radii": [self._world.airframe.radius_m]}
        body = rr.Cylinders3D(**size, colors=[color], labels=[name], fill_mode="solid")
        self._log_static(f"world/drone/{drone}/body", body)
        self._log_static(f"world/velocity/{drone}", rr.Arrows3D.from_fields(colors=[color]))
        self._log_static(f"world/choice/{drone}", rr.Arrows3D.from_fields(colors=[CHOICE_COLOR]))
        self._log_static(f"world/command/{drone}", rr.Arrows3D.from_fields(colors=[COMMAND_COLOR]))
        self._log_static(f"world/slot/{drone}", rr.Points3D.from_fields(radii=[0.12], colors=[color]))
        self._log_static(f"world/believed/{drone}", rr.Points3D.from_fields(radii=[0.15], colors=[BELIEVED_COLOR]))
        for depth, error_color in ERROR_COLORS.items():
            for curve in ERROR_CURVES:
                line = rr.SeriesLines(colors=[error_color], names=[depth])
                self._log_static(f"drone/{drone}/{curve}/{depth}", line)
        self._log_static(f"world/trail/{drone}", rr.Points3D.from_fields(radii=[0.07], colors=[color]))
        self._log_static(f"world/map/{drone}/drone", rr.Arrows2D.from_fields(radii=[0.6], colors=[color]))
        colors = rr.StateConfiguration(values=list(STATE_COLORS), colors=list(STATE_COLORS.values()))
        self._log_static(f"drone/{drone}/state", colors)
        for (curve, words), width in zip(CURVES.items(), (2.0, 1.0), strict=True):
            self._log_static(f"drone/{drone}/{curve}", rr.SeriesLines(colors=[color], names=[words], widths=[width]))

    def _log_images(self, capture: Capture, corrected: CorrectedDepth) -> None:
        log = partial(self._log_image, capture.drone)
        log_frame(log, capture.gray_left, capture.depth_raw_m, corrected)
        log_depth(log, "true", finite(capture.depth_true_m))
        log_error(log, corrected.depth_m, finite(capture.depth_true_m))
        if capture.gray_right is not None:
            log("gray_right", jpeg(capture.gray_right))
        log_warped(log, corrected)
        positions, labels = cloud(capture, corrected)
        self._columns.add(f"world/cloud/{capture.drone}", rr.Points3D, positions=positions, class_ids=labels)

    def _log_work(self, capture: Capture, corrected: CorrectedDepth) -> None:
        """Record the diagnostics of a corrector, and the template and its voxels when an epoch begins."""
        drone = capture.drone
        for depth, depth_m in (("raw", capture.depth_raw_m), ("corrected", corrected.depth_m)):
            errors = depth_errors(depth_m, capture.depth_true_m, max_range_m=EVALUATED_RANGE_M)
            for curve, value in zip(ERROR_CURVES, (errors.mae_m, errors.hole_share), strict=True):
                if value is not None:
                    self._add_number(f"drone/{drone}/{curve}/{depth}", value)
        for name, fact in ({} if corrected.diagnostics is None else corrected.diagnostics.facts()).items():
            entity = f"drone/{drone}/corrector/{name}"
            if isinstance(fact, str):
                self._add_state(entity, fact.replace("_", " "))
            else:
                self._add_number(entity, fact)
        self._camera_poses[drone, capture.stamp_s] = capture.T_world_cam
        if (template := new_template(corrected)) is not None:
            log_depth(partial(self._log_image, drone), "template", template.depth_m)
            T_world_cam = self._camera_poses[drone, template.stamp_s]
            self._stream.log(f"world/voxels/{drone}", voxel_cloud(template, T_world_cam))

    def _add_odometry(self, drone: int, state: DroneState, decision: Decision) -> None:
        """Record where a drone believes that it is, and the way that it plans."""
        assert decision.view is not None, "a drone with a map has an odometry"
        at_m, way_m = decision.view.from_world(state.position_m), np.zeros((0, 3))
        self._columns.add(f"world/believed/{drone}", rr.Points3D, positions=[at_m])
        if decision.path_m is not None:
            heights_m = np.full(len(decision.path_m), at_m[2])
            way_m = decision.view.in_world(np.column_stack([decision.path_m, heights_m]))
        self._stream.log(f"world/path/{drone}", rr.LineStrips3D([way_m], colors=[CHOICE_COLOR]))

    def _log_map(self, drone: int, state: DroneState, costs: MapView) -> None:
        """Record a map as the image of a camera that looks down on the world, with an arrow for the drone.

        The image is one metre before the camera, where a pixel is as large as a cell of the map.
        """
        rows, cols = costs.state.shape
        side_m, entity, T = VOXEL_M, f"world/map/{drone}", costs.T_odom_world
        middle_m = costs.origin_m + side_m / 2 * np.array([cols, rows])
        down = np.linalg.inv(T) @ pose(np.diag([1.0, -1.0, -1.0]), np.array([*middle_m, 0.0]))
        camera = rr.Pinhole(
            focal_length=1 / side_m, width=cols, height=rows, image_plane_distance=1.0, color=MAP_EDGE, line_width=0.01
        )
        height_m = state.position_m[2] - BELOW_M + 1.0
        above = rr.Transform3D(translation=[*down[:2, 3], height_m], mat3x3=down[:3, :3])
        self._stream.log(entity, rr.SegmentationImage(np.flipud(costs.state)), camera, above)
        top_left_m, px_per_m = costs.origin_m + np.array([0, side_m * rows]), np.array([1, -1]) / side_m
        at_m = T[:2, :3] @ state.position_m + T[:2, 3]
        ahead = T[:2, :3] @ rotation_from_quaternion(state.q_world_body_xyzw)[:, 0]
        at_px, ahead_px = (at_m - top_left_m) * px_per_m, HEADING_M * ahead * px_per_m
        self._columns.add(f"{entity}/drone", rr.Arrows2D, origins=[at_px], vectors=[ahead_px])


def drone_name(drone: int, leaders: set[int]) -> str:
    """Return a drone as its label and its tab call it."""
    return f"leader {drone}" if drone in leaders else f"drone {drone}"


def blueprint(n_drones: int, leaders: set[int], has_stages: bool, first: Contact | None = None) -> rrb.Blueprint:
    """Return the layout that is saved with the recording.

    With a first contact it opens at the drone that had it, and repeats the seconds before and after it.

    Args:
        n_drones: Number of all drones.
        leaders: Indices of the leaders.
        has_stages: Whether the stages of the paper's method are shown.
        first: The first contact of the mission; None without any.
    """
    drones = range(n_drones)
    curves = [
        # The labels of the world have the same colours as the curves.
        rrb.TimeSeriesView(name=words, contents=[f"drone/{i}/{curve}" for i in drones], plot_legend=NO_LEGEND)
        for curve, words in CURVES.items()
    ]
    formation = rrb.TimeSeriesView(
        name="formation error [m]", contents=["metrics/formation_error_m"], plot_legend=NO_LEGEND
    )
    states = rrb.StateTimelineView(name="states", contents=[f"drone/{i}/state" for i in drones])
    events = rrb.TextLogView(name="events", origin="events", columns=EVENT_COLUMNS)
    last = rrb.Vertical(formation, events) if n_drones > len(leaders) else events
    below = rrb.Horizontal(states, rrb.Vertical(*curves), last, column_shares=[3, 3, 2])
    left = rrb.Vertical(_world_view(n_drones, leaders), below, row_shares=[5, 4])
    tabs = [rrb.Vertical(*_rows(drone, has_stages), name=drone_name(drone, leaders)) for drone in drones]
    time: dict[str, Any] = {}
    if first is not None:
        tabs[first.drone].name = f"{tabs[first.drone].name} hits {first.other}"
        around = rrb.components.AbsoluteTimeRange(*(int(1e9 * (first.time_s + s)) for s in AROUND_CONTACT_S))
        time = {"loop_mode": "selection", "time_selection": around}
    cameras = rrb.Tabs(*tabs, name="cameras", active_tab=first.drone if first else 0)
    return layout(rrb.Horizontal(left, cameras, column_shares=[3, 2]), "sim_time", **time)


def _world_view(n_drones: int, leaders: set[int]) -> rrb.Spatial3DView:
    """Return the view of the world from above and behind; its origin is the middle of a swarm, with which it moves."""
    # Rerun expands `**` at the end of a path only, so every drone's images are left out by name.
    images = [f"- world/drone/{i}/{name}/**" for i in range(n_drones) for name in SHARED_VIEWS]
    flown = rrb.VisibleTimeRanges(
        timeline="sim_time", start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative()
    )
    trails = {f"world/trail/{i}": flown for i in range(n_drones)}
    others = [i for i in range(n_drones) if i not in leaders]
    hidden = {
        f"world/{what}/{i}": rrb.EntityBehavior(visible=False) for i in others for what in ("map", "cloud", "voxels")
    }
    return rrb.Spatial3DView(
        name="world",
        origin="world/swarm",
        contents=["+ world/**", *images],
        eye_controls=rrb.EyeControls3D(position=EYE_M, look_target=(3.0, 0.0, 0.0), eye_up=(0.0, 0.0, 1.0)),
        overrides=trails | hidden,
    )


def _rows(drone: int, has_stages: bool) -> list[rrb.Horizontal]:
    """Return the views of a drone, two in a row; the stages of the paper's method are in place of the confidence."""
    known = rrb.Spatial2DView(name="map", origin=f"world/map/{drone}")
    true, raw, corrected = (_image(drone, f"depth, {name}", f"colors/{name}") for name in ("true", "raw", "corrected"))
    rows = [
        rrb.Horizontal(_image(drone, "gray", "gray"), known),
        rrb.Horizontal(true, raw),
        rrb.Horizontal(corrected, _image(drone, "source", "source")),
    ]
    errors = [rrb.TimeSeriesView(name=words, contents=[f"drone/{drone}/{c}/**"]) for c, words in ERROR_CURVES.items()]
    rows.append(rrb.Horizontal(_image(drone, "relative error", "colors/error"), rrb.Vertical(*errors)))
    if not has_stages:
        curves = rrb.TimeSeriesView(name=", ".join(CURVES.values()), contents=[f"drone/{drone}/{c}" for c in CURVES])
        return [*rows, rrb.Horizontal(_image(drone, "confidence", "confidence"), curves)]
    at = f"drone/{drone}/corrector/"
    states = [f"{at}{name}" for name in ("phase", "registration", "epoch_end")]
    facts = rrb.Horizontal(
        rrb.StateTimelineView(name="VoxDepth (the paper)", contents=states),
        rrb.TimeSeriesView(name="matches, inliers", contents=[f"{at}n_matches", f"{at}n_inliers"]),
        rrb.TimeSeriesView(name="epoch", contents=[f"{at}epoch"], plot_legend=NO_LEGEND),
        column_shares=[2, 1, 1],
    )
    template, warped = _image(drone, "template", "colors/template"), _image(drone, "template, warped", "colors/warped")
    return [*rows, rrb.Horizontal(template, warped), facts]


def _image(drone: int, name: str, path: str) -> rrb.Spatial2DView:
    cam = f"world/drone/{drone}/cam"
    return rrb.Spatial2DView(name=name, origin=cam, contents=[f"{cam}/{path}"])


def cloud(capture: Capture, corrected: CorrectedDepth) -> tuple[FloatArray, npt.NDArray[np.uint8]]:
    """Return points of the corrected depth, world frame, shape (n, 3), and their labels, shape (n,)."""
    depth_m, at = np.zeros_like(corrected.depth_m), np.s_[::CLOUD_STEP_PX, ::CLOUD_STEP_PX]
    depth_m[at] = np.where(corrected.depth_m[at] < FAR_M, corrected.depth_m[at], 0)
    points_cam_m = back_project(depth_m, capture.intrinsics).astype(np.float64)
    labels = labels_of(capture.depth_raw_m, corrected.source)[depth_m > 0]
    return transform(capture.T_world_cam, points_cam_m), labels
