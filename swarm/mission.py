"""One flight of a leader and its followers, from take-off to an outcome."""

from collections.abc import Sequence

import numpy as np
from pydantic import Field

from sim.rig import Mapper, StereoRig
from sim.types import Capture, Contact, DroneState
from sim.world import PHYSICS_HZ, World
from voxdepth.model import Model
from voxdepth.types import CorrectedDepth, DepthCorrector, FloatArray

from . import formation
from .agents import Agent, Follower, Leader
from .errors import MissionError
from .formation import FormationConfig
from .link import Link, LinkConfig
from .metrics import DepthComparison, MissionMetrics
from .perception import Perception
from .pilot import Pilot, PilotConfig, Situation
from .priors import PosePriorConfig, make_prior
from .recorder import Recorder
from .rules import RuleWeights
from .types import MissionResult, Outcome

Point = tuple[float, float, float]
PROGRESS_M = 0.3
"""Less than this is no progress."""


class MissionConfig(Model):
    """The task, and the swarm that flies it."""

    drones: int = Field(8, ge=1)
    """The leader is drone 0; all others follow."""
    start_m: Point = Field((-8.0, 0.0, 6.0), strict=False)
    """Where the leader starts; the followers start in their slots."""
    goal_m: Point = Field((76.0, 0.0, 6.0), strict=False)
    duration_s: float = Field(75.0, gt=0)
    """Simulated time after which the mission counts as timed out."""
    cruise_speed_m_s: float = Field(2.5, gt=0)
    """Speed of the leader."""
    follower_speed_m_s: float = Field(3.2, gt=0)
    """Largest speed of a follower; above the leader's, to catch up."""
    control_hz: int = Field(20, ge=1)
    latency_s: float = Field(0.03, ge=0)
    """Simulated time from a capture to the moment its result can be flown by."""
    goal_radius_m: float = Field(1.5, gt=0)
    formation_tolerance_m: float = Field(1.5, gt=0)
    """Largest distance of any follower from its slot that counts as being in formation."""
    deadlock_s: float = Field(12.0, gt=0)
    """Time in which neither leader nor followers get anywhere, after which the mission counts as stuck."""
    lost_m: float = Field(30.0, gt=0)
    """Distance from the leader beyond which a follower counts as lost."""
    aftermath_s: float = Field(1.0, ge=0)
    """How long the world runs on after the first collision."""
    formation: FormationConfig = FormationConfig()
    rules: RuleWeights = RuleWeights()
    pilot: PilotConfig = PilotConfig()
    link: LinkConfig = LinkConfig()
    pose_prior: PosePriorConfig = PosePriorConfig()

    @property
    def heading_rad(self) -> float:
        """Direction from start to goal in the horizontal plane."""
        return float(np.arctan2(self.goal_m[1] - self.start_m[1], self.goal_m[0] - self.start_m[0]))

    def offsets_m(self) -> FloatArray:
        """Slots of the followers relative to the leader, shape (drones - 1, 3), in the world frame."""
        return formation.turned(formation.slots(self.drones - 1, self.formation), self.heading_rad)

    def starts_m(self) -> FloatArray:
        """Start positions of all drones, shape (drones, 3)."""
        leader = np.array(self.start_m)
        return np.vstack([leader[None], leader + self.offsets_m()])


class Mission:
    """Runs a swarm in a world, tick by tick.

    Args:
        world: With one drone per agent, at `config.starts_m()`.
        rig: The drones' cameras.
        correctors: One per drone.
        camera_hz: Captures per second; must divide `config.control_hz`.
        seed: Master seed of the drones' pose priors.
        recorder: Told of everything; closed by whoever made it.
        pool_map: Runs the drones' perception side by side; the result is the same with any.
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
        seed: int,
        pool_map: Mapper = map,
    ) -> None:
        self._steps_per_tick = _whole_ratio(PHYSICS_HZ, config.control_hz, "control_hz", "the physics rate")
        self._ticks_per_frame = _whole_ratio(config.control_hz, camera_hz, "rate_hz", "control_hz")
        if world.room_at_m(config.goal_m) < world.airframe.radius_m:
            raise MissionError(
                f"the goal {list(config.goal_m)} m is inside a building or the ground; move it into the open"
            )
        self._config = config
        self._world = world
        self._rig = rig
        self._recorder = recorder
        self._map = pool_map
        self._offsets_m = config.offsets_m()
        self._agents = self._make_agents()
        self._perceptions = [
            Perception(
                corrector,
                rig.intrinsics,
                config.pilot.avoidance,
                latency_s=config.latency_s,
                prior=make_prior(config.pose_prior, seed=seed, drone=drone),
            )
            for drone, corrector in enumerate(correctors)
        ]
        self._link = Link(config.link, config.control_hz)
        self._metrics = MissionMetrics(world)
        self._ticks = 0
        self._least_left_m = np.full(2, np.inf)
        self._progress_at_s = 0.0
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
            self._recorder.start(self._world, np.array(self._config.goal_m))
        self._perceive()
        self._decide()
        self._fly()
        self._judge()

    def interrupt(self) -> None:
        """End the mission from outside."""
        self._end(Outcome.INTERRUPTED)

    def result(self) -> MissionResult:
        """What became of the mission; it must have ended."""
        if self.outcome is None:
            raise MissionError("the mission has not ended yet: call tick() until there is an outcome")
        contacts = tuple(self._world.contacts)
        dropped = sum(p.dropped for p in self._perceptions)
        return MissionResult(
            outcome=self.outcome,
            contacts=contacts,
            trajectories=self._metrics.trajectories(),
            metrics=self._metrics.summary(contacts, dropped),
        )

    def _perceive(self) -> None:
        """Capture and correct, for every drone that is not still busy with an earlier image."""
        if self._ticks % self._ticks_per_frame:
            return
        ready = [i for i, perception in enumerate(self._perceptions) if perception.ready(self.time_s)]
        captures = self._rig.capture(ready, self._ticks // self._ticks_per_frame)
        for capture, (corrected, errors) in zip(captures, self._map(self._see, captures), strict=True):
            self._metrics.add_depth(errors)
            histogram = self._perceptions[capture.drone].newest_histogram
            self._recorder.capture(self._world.steps, capture, corrected, histogram)

    def _see(self, capture: Capture) -> tuple[CorrectedDepth, DepthComparison]:
        corrected = self._perceptions[capture.drone].see(capture)
        return corrected, DepthComparison.of(capture, corrected)

    def _decide(self) -> None:
        states = self._world.states
        self._link.broadcast(states)
        decisions = [agent.decide(self._situation(i, states[i])) for i, agent in enumerate(self._agents)]
        self._world.apply([decision.command for decision in decisions])
        slots_m = states[0].position_m + self._offsets_m
        figures = self._metrics.sample(states, slots_m)
        self._recorder.tick(self._world.steps, self.time_s, states, slots_m, decisions)
        self._recorder.metrics(self._world.steps, self.time_s, figures)

    def _situation(self, drone: int, own: DroneState) -> Situation:
        return Situation(
            time_s=self.time_s,
            own=own,
            percept=self._perceptions[drone].latest(self.time_s),
            leader=self._link.leader(),
            neighbours=self._link.heard_by(drone),
        )

    def _fly(self) -> None:
        for _ in range(self._steps_per_tick):
            for contact in self._world.step():
                self._recorder.contact(self._world.steps, contact)
        self._ticks += 1

    def _judge(self) -> None:
        """End the mission when one of the outcomes has come about."""
        c, states = self._config, self._world.states
        followers = np.array([s.position_m for s in states[1:]]).reshape(-1, 3)
        off_slot_m = np.linalg.norm(followers - (states[0].position_m + self._offsets_m), axis=1)
        to_goal_m = float(np.linalg.norm(states[0].position_m - np.array(c.goal_m)))
        if self._world.contacts:
            if self.time_s >= self._world.contacts[0].time_s + c.aftermath_s:
                self._end(Outcome.COLLISION)
        elif to_goal_m <= c.goal_radius_m and (off_slot_m <= c.formation_tolerance_m).all():
            self._end(Outcome.SUCCESS)
        elif (np.linalg.norm(followers - states[0].position_m, axis=1) > c.lost_m).any():
            self._end(Outcome.LOST)
        elif self._stuck(to_goal_m, float(off_slot_m.sum())):
            self._end(Outcome.DEADLOCK)
        elif self.time_s >= c.duration_s:
            self._end(Outcome.TIMEOUT)

    def _stuck(self, to_goal_m: float, off_slots_m: float) -> bool:
        """Whether for `deadlock_s` the leader came no nearer to the goal, nor the followers to their slots."""
        left_m = np.array([to_goal_m, off_slots_m])
        if (left_m < self._least_left_m - PROGRESS_M).any():
            self._least_left_m = np.minimum(self._least_left_m, left_m)
            self._progress_at_s = self.time_s
        return self.time_s - self._progress_at_s > self._config.deadlock_s

    def _end(self, outcome: Outcome) -> None:
        self.outcome = outcome
        self._recorder.outcome(self._world.steps, self.time_s, outcome)

    def _make_agents(self) -> list[Agent]:
        c = self._config

        def pilot() -> Pilot:
            return Pilot(c.pilot, c.control_hz, c.heading_rad)

        followers = [Follower(pilot(), c.rules, offset_m, c.follower_speed_m_s) for offset_m in self._offsets_m]
        leader = Leader(pilot(), c.rules, np.array(c.goal_m), self._offsets_m, c.cruise_speed_m_s)
        return [leader, *followers]


def _whole_ratio(fast_hz: float, slow_hz: float, name: str, of: str) -> int:
    ratio = fast_hz / slow_hz
    if ratio < 1 or abs(ratio - round(ratio)) > 1e-9:
        raise MissionError(f"{name} must divide {of} of {fast_hz:g} Hz without remainder, got {slow_hz:g} Hz")
    return round(ratio)


def contact_text(contact: Contact) -> str:
    """A collision in one line."""
    return f"drone {contact.drone} hit {contact.other} ({contact.kind}) at {contact.speed_m_s:.1f} m/s"
