"""One flight of leaders and their followers, from take-off to an outcome."""

from collections.abc import Sequence

import numpy as np

from sim.frames import R_BODY_CAM
from sim.rig import StereoRig
from sim.types import Capture, Contact, DroneState
from sim.world import PHYSICS_HZ, World
from voxdepth.types import CorrectedDepth, DepthCorrector, FloatArray

from .controllers import Agent, Factory, Role, load_controller
from .detection import Detector
from .errors import MissionError
from .histogram import HistogramBuilder
from .judge import Judge
from .link import Link
from .metrics import DepthComparison, MissionMetrics
from .neighbours import NeighbourSense
from .perception import Perception
from .pilot import Situation
from .priors import make_prior
from .recorder import Recorder
from .task import MissionConfig
from .types import MissionResult, Outcome


class Mission:
    """Runs swarms in a world, tick by tick.

    Args:
        config: The task.
        world: With one drone per member of the teams, at `starts_m(config)`.
        rig: The drones' cameras.
        correctors: One per drone.
        camera_hz: Captures per second; must divide `config.control_hz`.
        latency_s: Simulated time from a capture to the moment its result can be flown by.
        seed: Master seed of pose priors, detector and radio.
        recorder: Told of everything; closed by whoever made it.
        make_agent: Makes the drones' agents; without it, `config.controller` names who does.
    """

    def __init__(
        self,
        config: MissionConfig,
        world: World,
        rig: StereoRig,
        correctors: Sequence[DepthCorrector],
        recorder: Recorder,
        *,
        camera_hz: float,
        latency_s: float,
        seed: int,
        make_agent: Factory | None = None,
    ) -> None:
        self._steps_per_tick = _whole_ratio(PHYSICS_HZ, config.control_hz, "control_hz", "the physics rate")
        self._ticks_per_frame = _whole_ratio(config.control_hz, camera_hz, "rate_hz", "control_hz")
        self._config = config
        self._world = world
        self._teams = config.teams()
        self._refuse_bad_goals()
        self._rig = rig
        self._recorder = recorder
        self._latency_s = latency_s
        self._perceptions = [
            self._perception(drone, corrector, seed=seed) for drone, corrector in enumerate(correctors)
        ]
        self._senses = [NeighbourSense(config.neighbours, rig.intrinsics, world.n_drones) for _ in correctors]
        self._team_of = [team for team in self._teams for _ in team.members]
        leaders = [team.leader for team in self._team_of]
        self._link = Link(config.link, world.states, config.control_hz, seed=seed, leaders=leaders)
        self._link.broadcast(world.states, self.time_s)
        self._agents = self._make_agents(make_agent or load_controller(config.controller))
        self._judge_of = Judge(config, self._teams)
        self._metrics = MissionMetrics(world, self._teams)
        self._ticks = 0
        self.outcome: Outcome | None = None

    @property
    def time_s(self) -> float:
        """Simulated time [s]."""
        return self._world.time_s

    def run(self) -> MissionResult:
        """Fly to the end."""
        while self.outcome is None:
            self.tick()
        return self.result()

    def tick(self) -> None:
        """One control period: look, decide, fly, judge."""
        if self._ticks == 0:
            self._recorder.start(self._world, self._teams)
        self._perceive()
        self._decide()
        self._fly()
        self._judge()

    def interrupt(self) -> None:
        """End the mission from outside."""
        self._end(Outcome.INTERRUPTED)

    def situation(self, drone: int) -> Situation:
        """What a drone knows now, before the next tick; asking changes nothing."""
        return self._situation(drone, self._world.states[drone])

    def result(self) -> MissionResult:
        """What became of the mission; it must have ended."""
        if self.outcome is None:
            raise MissionError("the mission has not ended yet: call tick() until there is an outcome")
        contacts = tuple(self._world.contacts)
        dropped = [p.dropped for p in self._perceptions]
        return MissionResult(
            outcome=self.outcome,
            contacts=contacts,
            trajectories=self._metrics.trajectories(),
            metrics=self._metrics.summary(contacts, dropped),
            drones=self._metrics.by_drone(contacts, dropped),
        )

    def _perceive(self) -> None:
        """Capture and correct, for every drone that is not still busy with an earlier image."""
        if self._ticks % self._ticks_per_frame:
            return
        ready = [i for i, perception in enumerate(self._perceptions) if perception.ready(self.time_s)]
        # One by one: correctors hold Python's lock too much to gain by threads. The next captures are made meanwhile.
        for capture in self._rig.capture(ready, self._ticks // self._ticks_per_frame):
            corrected, errors = self._see(capture)
            self._metrics.add_depth(capture.drone, errors)
            histogram = self._perceptions[capture.drone].newest.histogram
            self._recorder.capture(self._world.steps, capture, corrected, histogram)

    def _see(self, capture: Capture) -> tuple[CorrectedDepth, DepthComparison]:
        corrected = self._perceptions[capture.drone].see(capture)
        return corrected, DepthComparison.of(capture, corrected)

    def _decide(self) -> None:
        states = self._world.states
        decisions = [agent.decide(self._situation(i, states[i])) for i, agent in enumerate(self._agents)]
        self._world.apply([decision.command for decision in decisions])
        slots_m = self._slots_m(states)
        figures = self._metrics.sample(states)
        self._recorder.tick(self._world.steps, self.time_s, states, slots_m, decisions)
        self._recorder.metrics(self._world.steps, self.time_s, figures)

    def _situation(self, drone: int, own: DroneState) -> Situation:
        heard = self._link.heard_by(drone, self.time_s)
        percept = self._perceptions[drone].latest(self.time_s)
        return Situation(
            time_s=self.time_s,
            own=own,
            percept=percept,
            leader=self._link.leader_of(drone, self.time_s),
            mates=heard.among(self._team_of[drone].members),
            neighbours=self._senses[drone].perceive(percept, heard, self.time_s),
        )

    def _fly(self) -> None:
        for _ in range(self._steps_per_tick):
            for contact in self._world.step():
                self._recorder.contact(self._world.steps, contact)
        self._ticks += 1
        self._link.broadcast(self._world.states, self.time_s)

    def _judge(self) -> None:
        """End the mission when one of the outcomes has come about."""
        positions_m = np.array([state.position_m for state in self._world.states])
        outcome = self._judge_of.judge(self.time_s, positions_m, self._world.contacts)
        if outcome is not None:
            self._end(outcome)

    def _end(self, outcome: Outcome) -> None:
        self.outcome = outcome
        self._recorder.outcome(self._world.steps, self.time_s, outcome)

    def _slots_m(self, states: Sequence[DroneState]) -> FloatArray:
        """Where all followers belong, shape (n, 3)."""
        return np.vstack([team.slots_m(states[team.leader].position_m)[1:] for team in self._teams])

    def _perception(self, drone: int, corrector: DepthCorrector, *, seed: int) -> Perception:
        config, camera, world = self._config, self._rig.intrinsics, self._world
        return Perception(
            corrector,
            HistogramBuilder(camera, config.pilot.avoidance.histogram, R_BODY_CAM.T @ self._rig.mount_m),
            Detector(
                config.neighbours.detector,
                camera,
                world.drone_ids,
                radius_m=world.airframe.radius_m,
                seed=seed,
                drone=drone,
            ),
            latency_s=self._latency_s,
            prior=make_prior(config.pose_prior, seed=seed, drone=drone),
        )

    def _make_agents(self, make: Factory) -> list[Agent]:
        radius_m = self._world.airframe.radius_m
        roles = [Role(drone=i, team=team, radius_m=radius_m) for i, team in enumerate(self._team_of)]
        return [make(role, self._config) for role in roles]

    def _refuse_bad_goals(self) -> None:
        for team in self._teams:
            if self._world.clearance_at_m(team.goal_m.tolist()) < self._world.airframe.radius_m:
                raise MissionError(
                    f"the goal {team.goal_m.tolist()} m is inside a building or the ground; move it into the open"
                )


def starts_m(config: MissionConfig) -> FloatArray:
    """Start positions of all drones, shape (N, 3)."""
    return np.vstack([team.starts_m for team in config.teams()])


def start_yaws_rad(config: MissionConfig) -> FloatArray:
    """Headings of all drones at the start, shape (N,)."""
    return np.repeat([team.heading_rad for team in config.teams()], config.drones)


def _whole_ratio(fast_hz: float, slow_hz: float, name: str, of: str) -> int:
    ratio = fast_hz / slow_hz
    if ratio < 1 or abs(ratio - round(ratio)) > 1e-9:
        raise MissionError(f"{name} must divide {of} of {fast_hz:g} Hz without remainder, got {slow_hz:g} Hz")
    return round(ratio)


def contact_text(contact: Contact) -> str:
    """A collision in one line."""
    return f"drone {contact.drone} hit {contact.other} ({contact.kind}) at {contact.speed_m_s:.1f} m/s"
