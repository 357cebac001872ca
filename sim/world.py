"""The physical world: a scene with its movers, and drones, in one PyBullet client."""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from voxdepth.arithmetic import length
from voxdepth.types import FloatArray, MaskImage

from . import frames
from .bodies import Body, Cylinder, Heightfield, Mesh, Mover, Scene, Surface
from .drone import GRAVITY_M_S2, AirframeConfig, VelocityController, Wind
from .engine import contact_points, pybullet
from .errors import SceneError
from .solids import apply_texture, create_body, create_shapes
from .types import BodyPose, Contact, DroneState, VelocityCommand

PHYSICS_HZ = 240
REMOVED_AT_M = -1000.0
"""Height of the drones that were removed: below the ground, and less than a pixel in size where there is none."""
SMALLEST_PROBE_M = 1e-3
"""Radius of the sphere that stands for a point, because Bullet requires a positive radius."""
IMPACT_STEPS = 10
"""Steps before a contact at which its speed is taken, because Bullet brakes bodies that are about to touch."""
SKY_M = 200.0
"""Height above a point up to which there may be bodies."""
RAY_OFFSET_M = 1e-3
"""Distance behind a surface at which the search for the next surface begins."""
DRONE_SURFACE = Surface(albedo=0.15, texture=0.6)
DRONE_BODY_HEIGHT_M = 0.16


class World:
    """Steps physics, flies drones by velocity commands and reports the first contact of every pair of bodies.

    Use it as a context manager; the PyBullet client lives as long as the world. The collision shape of a drone is a
    sphere, and its visible shape is a flat cylinder of the same radius. The drones hover where they start. The movers
    of the scene have the first body ids, from 0 on; they follow the world's clock.

    Args:
        scene: All bodies except the drones, and the weather.
        starts_m: Start position of each drone in the world frame, shape (n, 3).
        airframe: Size, mass and limits of every drone; None takes the default.
        start_yaw_rad: Heading of all drones, or of each, shape (n,), from the world's x axis towards y.

    Raises:
        SceneError: A drone starts in contact with a body or another drone.
    """

    def __init__(
        self,
        scene: Scene,
        starts_m: FloatArray,
        airframe: AirframeConfig | None = None,
        *,
        start_yaw_rad: float | FloatArray = 0.0,
    ) -> None:
        self.scene = scene
        self.airframe = airframe or AirframeConfig()
        self.dt_s = 1 / PHYSICS_HZ
        self.steps = 0
        self.contacts: list[Contact] = []
        self._probes: dict[float, int] = {}
        """Collision spheres without a body, for distance queries, by radius."""
        self._recent: deque[FloatArray] = deque(maxlen=IMPACT_STEPS)
        self._touched: set[tuple[int, int]] = set()
        starts_m = np.asarray(starts_m, np.float64).reshape(-1, 3)
        self.n_drones = len(starts_m)
        self._removed: dict[int, DroneState] = {}
        """Last position of each drone that was removed, at rest."""
        self._moved_s: dict[int, float] = {}
        """Time for which each mover has moved."""
        self._mover_m: dict[int, FloatArray] = {}
        self._mover_velocity: dict[int, FloatArray] = {}
        self._controller = VelocityController(self.n_drones, self.airframe)
        self._wind = Wind(scene.weather.wind, self.airframe, self.dt_s, seed=scene.seed)
        self._desired_velocity = np.zeros((self.n_drones, 3))
        self._desired_yaw = np.full(self.n_drones, start_yaw_rad, np.float64)
        self.client = pybullet.connect(pybullet.DIRECT)
        try:
            self._create_bodies(starts_m)
            self._read_motion()
            self._require_free_starts()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> "World":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Disconnect the PyBullet client; a second call does nothing."""
        if self.client >= 0:
            pybullet.disconnect(physicsClientId=self.client)
            self.client = -1

    @property
    def time_s(self) -> float:
        """Simulated time [s]."""
        return self.steps / PHYSICS_HZ

    @property
    def flying(self) -> MaskImage:
        """Which drones were not removed, shape (n_drones,)."""
        return np.array([drone not in self._removed for drone in range(self.n_drones)], np.bool_)

    @property
    def states(self) -> list[DroneState]:
        """Motion of all drones now; one that was removed rests where it was last."""
        return [
            self._removed.get(i)
            or DroneState(
                position_m=self._position[i].copy(),
                velocity_m_s=self._velocity[i].copy(),
                q_world_body_xyzw=self._attitude[i].copy(),
                rates_rad_s=self._rates[i].copy(),
            )
            for i in range(self.n_drones)
        ]

    def pose(self, drone: int) -> BodyPose:
        """Pose of a drone now."""
        return BodyPose(
            stamp_s=self.time_s,
            position_m=self._position[drone].copy(),
            q_world_body_xyzw=self._attitude[drone].copy(),
            drone=drone,
        )

    def apply(self, commands: Sequence[VelocityCommand]) -> None:
        """Set the commands that hold from the next step on, one per drone; one that was removed ignores them."""
        if len(commands) != self.n_drones:
            raise SceneError(f"expected one command for each of {self.n_drones} drones, got {len(commands)}")
        for i, command in enumerate(commands):
            self._desired_velocity[i] = command.velocity_m_s
            self._desired_yaw[i] = command.yaw_rad

    def remove(self, drone: int) -> None:
        """Take a drone out of the scene: from now on it touches nothing, and no camera sees it.

        Its body stays, fixed and far below, because renderers have copies of all bodies.
        """
        self._removed[drone] = replace(self.states[drone], velocity_m_s=np.zeros(3), rates_rad_s=np.zeros(3))
        body, (x, y, _) = self.drone_ids[drone], self._position[drone].tolist()
        pybullet.changeDynamics(body, -1, mass=0, physicsClientId=self.client)
        pybullet.resetBaseVelocity(body, [0, 0, 0], [0, 0, 0], physicsClientId=self.client)
        at_m = [x, y, REMOVED_AT_M]
        pybullet.resetBasePositionAndOrientation(body, at_m, [0, 0, 0, 1], physicsClientId=self.client)
        self._read_motion()

    def move_to(self, time_s: float) -> None:
        """Put all movers where they are at a time, if none waits. `step` does so by the world's clock."""
        for body in self.movers:
            self._move(body, time_s)

    def _move(self, body: int, moved_s: float) -> None:
        """Put a mover where it is after it has moved for a time."""
        before_m, at_m = self._mover_m.get(body), self.movers[body].position_m(moved_s)
        self._moved_s[body], self._mover_m[body] = moved_s, at_m
        self._mover_velocity[body] = np.zeros(3) if before_m is None else (at_m - before_m) / self.dt_s
        q_xyzw = frames.quaternion_from_yaw(self.movers[body].body.yaw_rad).tolist()
        pybullet.resetBasePositionAndOrientation(body, at_m.tolist(), q_xyzw, physicsClientId=self.client)

    def movers_now(self) -> list[Body]:
        """Return the movers of the scene where they are now, in its order."""
        return [mover.at(self._moved_s[body]) for body, mover in self.movers.items()]

    def mover_positions_m(self) -> dict[int, FloatArray]:
        """Return where the movers' origins are now, shape (3,), by the numbers of their bodies."""
        return dict(self._mover_m)

    def _step_movers(self) -> None:
        """Move all movers that do not wait for a drone."""
        for body, mover in self.movers.items():
            apart_m = np.linalg.norm(self._position - self._mover_m[body], axis=1).min(initial=np.inf)
            self._move(body, self._moved_s[body] + (self.dt_s if apart_m >= mover.waits_m else 0.0))

    def step(self) -> list[Contact]:
        """Advance by 1/240 s and return the contacts that began in this step."""
        actuated = self._controller.actuate(
            self._velocity, self._attitude, self._rates, self._desired_velocity, self._desired_yaw, self.dt_s
        )
        wind_n = self._wind.step_n()
        bullet, client = pybullet, self.client
        for body, at_m, (force_n, torque_n_m) in zip(self.drone_ids, self._position.tolist(), actuated, strict=True):
            blown_n = [own + wind for own, wind in zip(force_n, wind_n, strict=True)]
            bullet.applyExternalForce(body, -1, blown_n, at_m, bullet.WORLD_FRAME, physicsClientId=client)
            bullet.applyExternalTorque(body, -1, torque_n_m, bullet.WORLD_FRAME, physicsClientId=client)
        self.steps += 1
        self._step_movers()
        bullet.stepSimulation(physicsClientId=client)
        self._recent.append(self._velocity)
        self._read_motion()
        return self._collect_contacts(self._recent[0])

    def clearance_m(self, drone: int, horizon_m: float = 5.0) -> float:
        """Distance from the drone's collision sphere to the nearest body or drone, at most `horizon_m`."""
        own = [self.drone_ids[drone]]
        return self._nearest_m(self._position[drone], self.airframe.radius_m, horizon_m, ignored=own)

    def nearest_point_m(self, drone: int, body: int, horizon_m: float = 5.0) -> FloatArray:
        """Point of a body that is nearest to a drone, world frame, shape (3,); both may touch."""
        found = pybullet.getClosestPoints(self.drone_ids[drone], body, horizon_m, physicsClientId=self.client)
        if not found:
            raise SceneError(
                f"expected a body within {horizon_m} m of drone {drone}, got {body}, which is farther away"
            )
        return np.array(min(contact_points(found), key=lambda point: point.distance_m).on_b_m)

    def clearance_at_m(self, position_m: Sequence[float], horizon_m: float = 5.0) -> float:
        """Distance from a point to the nearest body except drones, at most `horizon_m`; negative inside a body."""
        return self._nearest_m(np.asarray(position_m, np.float64), 0.0, horizon_m, ignored=self.drone_ids)

    def is_inside(self, position_m: FloatArray) -> bool:
        """Whether a point, shape (3,), lies inside a body or below a heightfield. Drones do not count.

        PyBullet knows the inside of convex solids only, and treats meshes and heightfields as surfaces. A point is
        inside of these if an odd number of their surfaces is overhead. A mesh that is not closed has no inside.
        """
        if self.clearance_at_m(position_m.tolist(), 1.0) < 0:
            return True
        start_m, up_m, odd = position_m, np.array([0.0, 0.0, SKY_M]), set[int]()
        while True:
            ends_m = [start_m.tolist()], [(start_m + up_m).tolist()]
            ((body, _, fraction, *_),) = pybullet.rayTestBatch(*ends_m, physicsClientId=self.client)
            if body < 0:
                break
            odd ^= {body}
            start_m = start_m + fraction * up_m + (0, 0, RAY_OFFSET_M)
        shapes = [self.bodies[body].shape for body in odd if body in self.bodies]
        return any(isinstance(shape, Heightfield) or (isinstance(shape, Mesh) and shape.is_closed) for shape in shapes)

    def is_clear(self, way_m: FloatArray, radius_m: float) -> bool:
        """Whether a sphere that moves along a polyline of points, shape (n, 3), touches no fixed body on it.

        The sphere is tried every half radius.
        """
        low, high = (way_m.min(axis=0) - radius_m).tolist(), (way_m.max(axis=0) + radius_m).tolist()
        near = pybullet.getOverlappingObjects(low, high, physicsClientId=self.client) or ()
        middle_m = (way_m.min(axis=0) + way_m.max(axis=0)) / 2
        reach_m = float(np.linalg.norm(way_m - middle_m, axis=1).max())
        fixed = (body for body, _ in near if body in self.bodies)
        bodies = [body for body in fixed if self._apart_m(body, middle_m, radius_m, reach_m) <= reach_m]
        if not bodies:
            return True
        steps = np.ceil(np.linalg.norm(np.diff(way_m, axis=0), axis=1) / (radius_m / 2)).astype(np.int64)
        ends = zip(way_m[:-1], way_m[1:], steps.tolist(), strict=True)
        parts = [np.linspace(start, end, n, endpoint=False) for start, end, n in ends]
        points_m = np.concatenate([*parts, way_m[-1:]])
        return all(self._apart_m(body, at_m, radius_m, 0.0) > 0 for at_m in points_m for body in bodies)

    def _create_bodies(self, starts_m: FloatArray) -> None:
        """Set physics up, and create all bodies: the movers first, then what is fixed, and last the drones."""
        pybullet.setGravity(0, 0, -GRAVITY_M_S2, physicsClientId=self.client)
        pybullet.setTimeStep(self.dt_s, physicsClientId=self.client)
        pybullet.setPhysicsEngineParameter(deterministicOverlappingPairs=1, physicsClientId=self.client)
        self.movers: dict[int, Mover] = {create_body(mover.body, self.client): mover for mover in self.scene.movers}
        """The movers of the scene by their body ids."""
        self.move_to(0.0)
        self.bodies: dict[int, Body] = {create_body(body, self.client): body for body in self.scene.bodies}
        """What is fixed, by body ids."""
        shape = Cylinder(self.airframe.radius_m, DRONE_BODY_HEIGHT_M)
        drones = [
            Body(name=f"drone-{drone}", kind="drone", shape=shape, surface=DRONE_SURFACE)
            for drone in range(self.n_drones)
        ]
        starts = zip(drones, starts_m, self._desired_yaw, strict=True)
        self.drone_ids = [self._add_drone(*start) for start in starts]
        self._drone_of_body = {body: drone for drone, body in enumerate(self.drone_ids)}
        moving = [mover.body for mover in self.scene.movers] + drones
        self.described = self.bodies | dict(zip([*self.movers, *self.drone_ids], moving, strict=True))
        """All bodies by id: what is fixed, the movers, and the drones."""
        apply_texture(self.described, self.scene.seed, self.client)

    @property
    def surfaces(self) -> dict[int, Surface]:
        """Surfaces of all bodies by id."""
        return {body_id: body.surface for body_id, body in self.described.items()}

    def _add_drone(self, drone: Body, start_m: FloatArray, yaw_rad: float) -> int:
        radius_m, client = self.airframe.radius_m, self.client
        collision = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=radius_m, physicsClientId=client)
        _, visual = create_shapes(drone.shape, drone.surface, client)
        pose = start_m.tolist(), frames.quaternion_from_yaw(yaw_rad).tolist()
        body = int(pybullet.createMultiBody(self.airframe.mass_kg, collision, visual, *pose, physicsClientId=client))
        pybullet.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
        return body

    def _read_motion(self) -> None:
        bullet, client = pybullet, self.client
        poses = [bullet.getBasePositionAndOrientation(body, physicsClientId=client) for body in self.drone_ids]
        motions = [bullet.getBaseVelocity(body, physicsClientId=client) for body in self.drone_ids]
        self._position = np.array([p for p, _ in poses]).reshape(-1, 3)
        self._attitude = np.array([q for _, q in poses]).reshape(-1, 4)
        self._velocity = np.array([v for v, _ in motions]).reshape(-1, 3)
        self._rates = np.array([w for _, w in motions]).reshape(-1, 3)

    def _collect_contacts(self, velocity_before: FloatArray) -> list[Contact]:
        new: list[Contact] = []
        for point in contact_points(pybullet.getContactPoints(physicsClientId=self.client)):
            pair = (min(point.body_a, point.body_b), max(point.body_a, point.body_b))
            if point.distance_m > 0 or pair in self._touched:
                continue
            self._touched.add(pair)
            if drones := sorted(self._drone_of_body.keys() & pair):
                (other,) = {*pair} - {drones[0]}
                new.append(self._contact(drones[0], other, velocity_before))
        self.contacts.extend(new)
        return new

    def _contact(self, own: int, other: int, velocity_before: FloatArray) -> Contact:
        """Return the contact of the body of a drone with another body."""
        relative, hit = velocity_before[self._drone_of_body[own]].copy(), self.described[other]
        if other in self.drone_ids:
            relative -= velocity_before[self._drone_of_body[other]]
        if other in self.movers:
            relative -= self._mover_velocity[other]
        drone, speed_m_s = self._drone_of_body[own], length(relative)
        return Contact(time_s=self.time_s, drone=drone, other=hit.name, kind=hit.kind, speed_m_s=speed_m_s)

    def _nearest_m(self, at_m: FloatArray, radius_m: float, horizon_m: float, *, ignored: Sequence[int]) -> float:
        """Signed distance from a sphere to the nearest body that is not ignored."""
        probe_radius_m = max(radius_m, SMALLEST_PROBE_M)
        reach = horizon_m + radius_m
        low, high = (at_m - reach).tolist(), (at_m + reach).tolist()
        near = pybullet.getOverlappingObjects(low, high, physicsClientId=self.client) or ()
        apart_m = (self._apart_m(body, at_m, probe_radius_m, horizon_m) for body, _ in near if body not in ignored)
        return min(horizon_m, min(apart_m, default=horizon_m) + probe_radius_m - radius_m)

    def _apart_m(self, body: int, at_m: FloatArray, radius_m: float, horizon_m: float) -> float:
        """Signed distance from a sphere to a body; +inf beyond `horizon_m`."""
        if radius_m not in self._probes:
            self._probes[radius_m] = pybullet.createCollisionShape(
                pybullet.GEOM_SPHERE, radius=radius_m, physicsClientId=self.client
            )
        found = pybullet.getClosestPoints(
            body,
            -1,
            horizon_m,
            collisionShapeA=-1,
            collisionShapeB=self._probes[radius_m],
            collisionShapePositionB=at_m.tolist(),
            physicsClientId=self.client,
        )
        return min((point.distance_m for point in contact_points(found)), default=np.inf)

    def _require_free_starts(self) -> None:
        pybullet.performCollisionDetection(physicsClientId=self.client)
        for drone in range(self.n_drones):
            if self.clearance_m(drone, 1.0) <= 0:
                x, y, z = self._position[drone]
                raise SceneError(
                    f"drone {drone} starts at ({x:.2f}, {y:.2f}, {z:.2f}) m in contact with another body; "
                    "move the start or spread the formation"
                )
