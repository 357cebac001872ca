"""One flight of leaders and their followers, from take-off to an outcome."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from sim.cpu import Mapper
from sim.sensor import StereoSensor
from sim.types import Capture, Contact, DroneState, RenderedPair, VelocityCommand
from sim.world import PHYSICS_HZ, World
from voxdepth.types import DepthCorrector, FloatArray

from .config import MissionConfig
from .controllers import Factory, Role
from .errors import MissionError
from .link import Link
from .metrics import MissionMetrics, Unmeasured, touched
from .perception import Perception
from .pilot import Decision, Situation
from .recorder import Recorder
from .team import Team, positions_of
from .types import MissionResult, Outcome, Percept

MIN_PROGRESS_M = 0.3
"""A smaller approach to the goal or the slots is no progress."""
DROPPED = Decision(command=VelocityCommand(velocity_m_s=np.zeros(3), yaw_rad=0.0), state="dropped out")
"""What stands for the decision of a drone that has dropped out."""


class Mission:
    """Runs swarms in a world, tick by tick; `compose.composed_mission` makes one from a configuration.

    Args:
        config: The task, and the swarms that fly it.
        world: World with one drone per member of the teams, at `config.starts_m()`.
        rig: Cameras of its drones.
        correctors: Corrector of each drone; None for a drone without a camera.
        recorder: Receives everything that happens; the caller closes it.
        camera_hz: Captures per second, which must divide `config.control_hz`.
        latency_s: Simulated time from a capture until the controller knows its percept.
        seed: Master seed of the radio, of missed detections and of drift.
        create_agent: Creates the agent of each drone.
        measured: Whether the mission has a result.
        pool_map: Maps over drones; one with several threads gives the same captures sooner.

    Raises:
        MissionError: The rates do not divide each other, or a start or a goal is inside of a body.
    """

    def __init__(
        self,
        config: MissionConfig,
        world: World,
        rig: StereoSensor,
        correctors: Sequence[DepthCorrector | None],
        recorder: Recorder,
        *,
        camera_hz: float,
        latency_s: float,
        seed: int,
        create_agent: Factory,
        measured: bool = True,
        pool_map: Mapper = map,
    ) -> None:
        self._steps_per_tick = _whole_ratio(PHYSICS_HZ, config.control_hz, "control_hz", "the physics rate")
        self._ticks_per_frame = _whole_ratio(config.control_hz, camera_hz, "rate_hz", "control_hz")
        self.world = world
        self._teams = config.teams()
        self._require_free_ends()
        self._config = config
        self._rig, self._map = rig, pool_map
        self._recorder = recorder
        self._team_of = [team for team in self._teams for _ in team.members]
        leaders = [team.leader for team in self._team_of]
        self._link = Link(config.link, world.states, config.control_hz, seed=seed, leaders=leaders)
        self._link.broadcast(world.states, self.time_s)
        roles = [
            Role(drone=i, team=team, airframe=world.airframe, camera=rig.intrinsics)
            for i, team in enumerate(self._team_of)
        ]
        self._perceptions = [
            Perception(role, config, corrector, world.drone_ids, latency_s=latency_s, seed=seed)
            for role, corrector in zip(roles, correctors, strict=True)
        ]
        self._agents = [create_agent(role, config) for role in roles]
        self._termination = TerminationConditions(config, self._teams)
        metrics = MissionMetrics if measured else Unmeasured
        self._metrics = metrics(config, world, self._teams)
        self._ticks = 0
        self._arriving: tuple[int, Iterator[tuple[Capture, Percept]]] = (0, iter(()))
        """The step of the newest images, and those that are left to receive: threads may still process them."""
        self._awaited: set[int] = set()
        """The drones of these images."""
        self._dropped_frames = 0
        self.outcome: Outcome | None = None

    @property
    def time_s(self) -> float:
        """Simulated time [s]."""
        return self.world.time_s

    def run(self) -> MissionResult:
        """Fly to the end."""
        while self.outcome is None:
            self.tick(wait=False)
        return self.result()

    def tick(self, *, wait: bool = True) -> None:
        """Fly one control period.

        Without `wait`, threads may still process its images afterwards. The recorder receives those before the next
        ones, before a contact and before the end, and a drone waits for its own when their latency has passed, so that
        all goes as it would with `wait`.
        """
        if self._ticks == 0:
            self._recorder.start(self.world, self._teams)
        if self._ticks % self._ticks_per_frame == 0:
            self._receive()
            self._perceive()
        states = self.world.states
        decisions = self._decide(states)
        metrics = self._metrics.sample(states, decisions)
        self._recorder.tick(self.world.steps, self.time_s, states, decisions)
        self._recorder.metrics(self.world.steps, self.time_s, metrics)
        self._move(decisions)
        moved = self.world.states
        self._link.broadcast(moved, self.time_s)
        positions_m = positions_of(moved, self.world.flying)
        self._metrics.follow(positions_m)
        outcome = self._termination.check(self.time_s, positions_m, self.world.contacts)
        if outcome is not None:
            self._end(outcome)
        self._ticks += 1
        if wait:
            self._receive()

    def interrupt(self) -> None:
        """End the mission from outside."""
        self._end(Outcome.INTERRUPTED)

    def situation(self, drone: int, own: DroneState | None = None) -> Situation:
        """Return what a drone knows before the next tick, with its state if that is read already; nothing changes."""
        heard = self._link.heard_by(drone, self.time_s)
        perception = self._perceptions[drone]
        if drone in self._awaited and not perception.is_busy(self.time_s):
            self._receive(drone)
        members = self._team_of[drone].members
        return Situation(
            time_s=self.time_s,
            own=own or self.world.states[drone],
            percept=perception.latest(self.time_s),
            leader=self._link.leader_of(drone, self.time_s),
            mates=heard.among(members),
            neighbours=perception.neighbours(heard, self.time_s),
            mates_dropped=int(np.count_nonzero(~self.world.flying[members.start : members.stop])),
        )

    def result(self) -> MissionResult:
        """Return the result of a mission that has ended.

        Raises:
            MissionError: The mission has not ended.
        """
        if self.outcome is None:
            raise MissionError("the mission has not ended yet: call tick() until there is an outcome")
        contacts = tuple(self.world.contacts)
        return MissionResult(
            outcome=self.outcome,
            contacts=contacts,
            trajectories=self._metrics.trajectories(),
            metrics=self._metrics.summary(contacts, self._dropped_frames),
            drones=self._metrics.by_drone(contacts, self._termination.ended),
        )

    def _perceive(self) -> None:
        """Capture an image of every drone that is not busy with an earlier one, and begin to process them."""
        seeing = [i for i in np.flatnonzero(self.world.flying).tolist() if self._perceptions[i].has_camera]
        ready = [i for i in seeing if not self._perceptions[i].is_busy(self.time_s)]
        self._dropped_frames += len(seeing) - len(ready)
        for drone in ready:
            self._perceptions[drone].begin(self.time_s)
        images = self._map(self._see, self._rig.render_drones(ready, self._ticks // self._ticks_per_frame))
        self._arriving, self._awaited = (self.world.steps, images), set(ready)

    def _receive(self, drone: int | None = None) -> None:
        """Receive the images that are processed, in the order of the drones: up to that of one of them, or all."""
        step, images = self._arriving
        for capture, percept in images:
            self._awaited.discard(capture.drone)
            self._recorder.capture(step, capture, percept.corrected)
            if capture.drone == drone:
                break

    def _see(self, pair: RenderedPair) -> tuple[Capture, Percept]:
        """Capture and process the image of one drone, which changes nothing that another drone's thread uses."""
        capture = self._rig.capture(pair)
        percept = self._perceptions[capture.drone].see(capture)
        self._metrics.add_depth(capture, percept.corrected)
        return capture, percept

    def _decide(self, states: Sequence[DroneState]) -> list[Decision]:
        return [
            agent.decide(self.situation(i, states[i])) if flies else DROPPED
            for i, (agent, flies) in enumerate(zip(self._agents, self.world.flying, strict=True))
        ]

    def _move(self, decisions: Sequence[Decision]) -> None:
        """Step the physics to the end of the control period."""
        self.world.apply([decision.command for decision in decisions])
        for _ in range(self._steps_per_tick):
            contacts = self.world.step()
            if contacts:
                self._receive()
            for contact in contacts:
                self._recorder.contact(self.world.steps, contact)
            if contacts and self._config.after_contact == "drop":
                self._drop(touched(contacts))

    def _drop(self, drones: Iterable[int]) -> None:
        """Take drones out of the mission for good, with the whole swarm of a leader."""
        for drone in drones:
            team = self._team_of[drone]
            for member in team.members if drone == team.leader else (drone,):
                if self.world.flying[member]:
                    self.world.remove(member)
                    self._link.drop(member)

    def _end(self, outcome: Outcome) -> None:
        self.outcome = outcome
        self._receive()
        self._recorder.outcome(self.world.steps, self.time_s, outcome)

    def _require_free_ends(self) -> None:
        """Refuse goals in or at a body, and starts in one; the world has refused starts at one."""
        for what, at_m, radius_m in (
            *((f"start of drone {i}", state.position_m, 0.0) for i, state in enumerate(self.world.states)),
            *(("goal", team.goal_m, self.world.airframe.radius_m) for team in self._teams),
        ):
            if self.world.clearance_at_m(at_m.tolist()) < radius_m or self.world.is_inside(at_m):
                position_m = at_m.round(6).tolist()
                raise MissionError(
                    f"the {what} {position_m} m is inside a building or the ground; move it into the open"
                )


class TerminationConditions:
    """Decides from the positions of all drones, tick by tick, whether and how a mission ends."""

    def __init__(self, config: MissionConfig, teams: Sequence[Team]) -> None:
        self._config = config
        self._teams = teams
        self._arrived = np.zeros(len(teams), np.bool_)
        self._least_left_m = np.full((len(teams), 2), np.inf)
        self._followers = np.array([len(team.members) - 1 for team in teams])
        self._progress_at_s = 0.0
        self.ended: Outcome | None = None
        """How those have ended the mission that had no part in a collision; None if they have not."""

    def check(self, time_s: float, positions_m: FloatArray, contacts: Sequence[Contact]) -> Outcome | None:
        """Return the outcome if the mission has ended; after a contact it is a collision, whatever ended the mission.

        `positions_m` has shape (N, 3), with NaN for drones that have dropped out, and `contacts` are all up to now.
        """
        over = all(team.is_over(positions_m) for team in self._teams)
        if contacts and (over or self._config.after_contact == "end"):
            last = contacts[-1] if over else contacts[0]
            return Outcome.COLLISION if time_s >= last.time_s + self._config.aftermath_s else None
        self.ended = self._ended(time_s, positions_m)
        return Outcome.COLLISION if self.ended and contacts else self.ended

    def _ended(self, time_s: float, positions_m: FloatArray) -> Outcome | None:
        """Return how the swarms that are left have ended the mission; None if they have not."""
        self._arrived |= [self._has_arrived(team, positions_m) for team in self._teams]
        if (self._arrived | [team.is_over(positions_m) for team in self._teams]).all():
            return Outcome.SUCCESS
        if any((team.strays_m(positions_m) > self._config.lost_m).any() for team in self._teams):
            return Outcome.LOST
        if self._is_stuck(time_s, positions_m):
            return Outcome.DEADLOCK
        return Outcome.TIMEOUT if time_s >= self._config.duration_s else None

    def _has_arrived(self, team: Team, positions_m: FloatArray) -> bool:
        """Return whether the leader is at its goal and all its followers are in formation."""
        c = self._config
        in_formation = (team.slot_errors_m(positions_m) <= c.formation_tolerance_m).all()
        return bool(in_formation) and team.distance_to_goal_m(positions_m) <= c.goal_radius_m

    def _is_stuck(self, time_s: float, positions_m: FloatArray) -> bool:
        """Return whether no leader approached its goal, and no followers their slots, for `deadlock_s`.

        It is no progress that the distance of a follower no longer counts because it has dropped out.
        """
        errors_m = [team.slot_errors_m(positions_m) for team in self._teams]
        goals_m = [team.distance_to_goal_m(positions_m) for team in self._teams]
        left_m = np.column_stack([goals_m, [own_m.sum() for own_m in errors_m]])
        followers = np.array([len(own_m) for own_m in errors_m])
        fewer = followers < self._followers
        self._least_left_m[fewer, 1], self._followers = left_m[fewer, 1], followers
        if (left_m < self._least_left_m - MIN_PROGRESS_M).any():
            self._least_left_m = np.fmin(self._least_left_m, left_m)
            self._progress_at_s = time_s
        return time_s - self._progress_at_s > self._config.deadlock_s


def _whole_ratio(fast_hz: float, slow_hz: float, name: str, of: str) -> int:
    ratio = fast_hz / slow_hz
    if ratio < 1 or abs(ratio - round(ratio)) > 1e-9:
        raise MissionError(f"{name} must divide {of} of {fast_hz:g} Hz without remainder, got {slow_hz:g} Hz")
    return round(ratio)


def contact_text(contact: Contact) -> str:
    """Describe a collision in one line."""
    return f"drone {contact.drone} hit {contact.other} ({contact.kind}) at {contact.speed_m_s:.1f} m/s"
