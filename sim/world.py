"""The physical world: one PyBullet client with a scene, a fleet of drones, and bodies that others move."""

from collections import deque
from collections.abc import Sequence
from types import TracebackType
from typing import Any

import numpy as np
import pybullet

from voxdepth.types import FloatArray

from . import frames
from .bodies import Body, Cylinder, Scene, Surface
from .drone import GRAVITY_M_S2, AirframeConfig, Fleet
from .errors import SceneError
from .solids import apply_texture, create_body, create_shapes
from .types import Contact, DroneState, VelocityCommand

PHYSICS_HZ = 240
SMALLEST_PROBE_M = 1e-3
"""Bullet measures distances from spheres of positive radius only."""
IMPACT_STEPS = 10
"""Steps back to where the speed of an impact is taken: Bullet brakes bodies that are about to touch."""
DRONE_SURFACE = Surface(albedo=0.15, texture=0.6)
DRONE_BODY_HEIGHT_M = 0.16


def drone_shape(radius_m: float) -> Cylinder:
    """What cameras see of a drone."""
    return Cylinder(radius_m, DRONE_BODY_HEIGHT_M)


class World:
    """Steps physics, flies drones by velocity commands and reports every first contact.

    Use it as a context manager; the PyBullet client lives as long as the world. The collision shape of a drone is a
    sphere; what cameras see of it is a flat cylinder of the same radius.

    Args:
        scene: Static bodies.
        starts_m: Start positions, shape (n, 3); drones hover there, heading along x.
        airframe: Of every drone.
        start_yaw_rad: Heading of the drones at the start: one for all, or one each, shape (n,).
        movers: Bodies that stay where they are until `place` moves them. They have the first body ids, from 0 on.

    Raises:
        SceneError: A drone starts inside or in touch with a body or another drone.
    """

    def __init__(
        self,
        scene: Scene,
        starts_m: FloatArray,
        airframe: AirframeConfig | None = None,
        *,
        start_yaw_rad: float | FloatArray = 0.0,
        movers: Sequence[Body] = (),
    ) -> None:
        self.scene = scene
        self.airframe = airframe or AirframeConfig()
        self.dt_s = 1 / PHYSICS_HZ
        self.steps = 0
        self.contacts: list[Contact] = []
        self._probes: dict[float, int] = {}
        self._recent: deque[FloatArray] = deque(maxlen=IMPACT_STEPS)
        self._touched: set[tuple[int, int]] = set()
        starts_m = np.asarray(starts_m, np.float64).reshape(-1, 3)
        self.n_drones = len(starts_m)
        self.client = pybullet.connect(pybullet.DIRECT)
        try:
            self._set_up_physics()
            self.movers: dict[int, Body] = {create_body(body, self.client): body for body in movers}
            self.bodies: dict[int, Body] = {create_body(body, self.client): body for body in scene.bodies}
            yaws_rad = np.full(self.n_drones, start_yaw_rad, np.float64)
            attitudes = [frames.quaternion_from_yaw(float(yaw)) for yaw in yaws_rad]
            self.drone_ids = [self._add_drone(*start) for start in zip(starts_m, attitudes, strict=True)]
            apply_texture(self.textured_ids, scene.seed, self.client)
            self._drone_of_body = {body: drone for drone, body in enumerate(self.drone_ids)}
            self._fleet = Fleet(self.n_drones, self.airframe)
            self._wanted_velocity = np.zeros((self.n_drones, 3))
            self._wanted_yaw = yaws_rad
            self._read_motion()
            self._refuse_bad_starts()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> "World":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the PyBullet client; a second call does nothing."""
        if self.client >= 0:
            pybullet.disconnect(physicsClientId=self.client)
            self.client = -1

    @property
    def time_s(self) -> float:
        """Simulated time [s]."""
        return self.steps / PHYSICS_HZ

    @property
    def states(self) -> list[DroneState]:
        """Motion of all drones now."""
        return [
            DroneState(
                position_m=self._position[i].copy(),
                velocity_m_s=self._velocity[i].copy(),
                q_world_body_xyzw=self._attitude[i].copy(),
                rates_rad_s=self._rates[i].copy(),
            )
            for i in range(self.n_drones)
        ]

    def apply(self, commands: Sequence[VelocityCommand]) -> None:
        """Set what each drone is to do from the next step on, one command per drone."""
        if len(commands) != self.n_drones:
            raise SceneError(f"expected one command for each of {self.n_drones} drones, got {len(commands)}")
        for i, command in enumerate(commands):
            self._wanted_velocity[i] = command.velocity_m_s
            self._wanted_yaw[i] = command.yaw_rad

    def place(self, mover: int, position_m: FloatArray) -> None:
        """Move one of `movers`, by its body id, to a position, shape (3,), at once."""
        if mover not in self.movers:
            raise SceneError(f"expected the id of a mover, one of {list(self.movers)}, got {mover}")
        _, q_xyzw = pybullet.getBasePositionAndOrientation(mover, physicsClientId=self.client)
        pybullet.resetBasePositionAndOrientation(mover, position_m.tolist(), q_xyzw, physicsClientId=self.client)

    def step(self) -> list[Contact]:
        """Advance by 1/240 s and return the contacts that began in this step."""
        force_n, torque_n_m = self._fleet.actuate(
            self._velocity, self._attitude, self._rates, self._wanted_velocity, self._wanted_yaw, self.dt_s
        )
        bullet, client = pybullet, self.client
        for body, force, at, torque in zip(
            self.drone_ids, force_n.tolist(), self._position.tolist(), torque_n_m.tolist(), strict=True
        ):
            bullet.applyExternalForce(body, -1, force, at, bullet.WORLD_FRAME, physicsClientId=client)
            bullet.applyExternalTorque(body, -1, torque, bullet.WORLD_FRAME, physicsClientId=client)
        bullet.stepSimulation(physicsClientId=client)
        self.steps += 1
        self._recent.append(self._velocity)
        self._read_motion()
        return self._collect_contacts(self._recent[0])

    def clearance_m(self, drone: int, horizon_m: float = 5.0) -> float:
        """Distance from the drone's collision sphere to the nearest body or drone, at most `horizon_m`."""
        return self._nearest_m(self._position[drone], self.airframe.radius_m, horizon_m, self.drone_ids[drone])

    def clearance_at_m(self, position_m: Sequence[float], horizon_m: float = 5.0) -> float:
        """Distance from a point to the nearest body that is no drone, at most `horizon_m`; negative inside one."""
        return self._nearest_m(np.asarray(position_m, np.float64), 0.0, horizon_m, None)

    @property
    def moving_ids(self) -> list[int]:
        """Ids of all that may be elsewhere from one moment to the next: drones, then movers."""
        return [*self.drone_ids, *self.movers]

    @property
    def described(self) -> dict[int, Body]:
        """All but the drones, by id: the bodies of the scene, then movers."""
        return {**self.bodies, **self.movers}

    @property
    def surfaces(self) -> dict[int, Surface]:
        """Looks of all bodies by id, drones included."""
        surfaces = {body_id: body.surface for body_id, body in self.described.items()}
        return surfaces | dict.fromkeys(self.drone_ids, DRONE_SURFACE)

    @property
    def textured_ids(self) -> list[int]:
        """Ids of all bodies that are not blank."""
        return [body_id for body_id, surface in self.surfaces.items() if surface.texture > 0]

    @property
    def extent_m(self) -> float:
        """Longest side of the box around all bodies, drones included; 0 when there are none."""
        boxes = [pybullet.getAABB(body, physicsClientId=self.client) for body in self.surfaces]
        if not boxes:
            return 0.0
        corners = np.array(boxes)
        return float((corners[:, 1].max(axis=0) - corners[:, 0].min(axis=0)).max())

    def _set_up_physics(self) -> None:
        client = self.client
        pybullet.setGravity(0, 0, -GRAVITY_M_S2, physicsClientId=client)
        pybullet.setTimeStep(self.dt_s, physicsClientId=client)
        pybullet.setPhysicsEngineParameter(deterministicOverlappingPairs=1, physicsClientId=client)

    def _add_drone(self, start_m: FloatArray, q_world_body_xyzw: FloatArray) -> int:
        radius = self.airframe.radius_m
        collision = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=radius, physicsClientId=self.client)
        _, visual = create_shapes(drone_shape(radius), DRONE_SURFACE, self.client)
        body = int(
            pybullet.createMultiBody(
                self.airframe.mass_kg,
                collision,
                visual,
                start_m.tolist(),
                q_world_body_xyzw.tolist(),
                physicsClientId=self.client,
            )
        )
        pybullet.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=self.client)
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
        for point in pybullet.getContactPoints(physicsClientId=self.client):
            a, b, distance_m = point[1], point[2], point[8]
            pair = (min(a, b), max(a, b))
            if distance_m > 0 or pair in self._touched:
                continue
            self._touched.add(pair)
            drones = sorted(self._drone_of_body[body] for body in pair if body in self._drone_of_body)
            if drones:
                new.append(self._contact(drones, pair, velocity_before))
        self.contacts.extend(new)
        return new

    def _contact(self, drones: list[int], pair: tuple[int, int], velocity_before: FloatArray) -> Contact:
        drone = drones[0]
        relative = velocity_before[drone].copy()
        if len(drones) == 2:
            other, kind = f"drone-{drones[1]}", "drone"
            relative -= velocity_before[drones[1]]
        else:
            hit = self.described[next(body for body in pair if body not in self.drone_ids)]
            other, kind = hit.name, hit.kind
        return Contact(
            time_s=self.time_s, drone=drone, other=other, kind=kind, speed_m_s=float(np.linalg.norm(relative))
        )

    def _nearest_m(self, at_m: FloatArray, radius_m: float, horizon_m: float, own_body: int | None) -> float:
        """Signed distance from a sphere to the nearest other body; drones count only for a drone."""
        probe_radius_m = max(radius_m, SMALLEST_PROBE_M)
        reach = horizon_m + radius_m
        low, high = (at_m - reach).tolist(), (at_m + reach).tolist()
        nearest = horizon_m
        probe = self._probe(probe_radius_m)
        for body, _ in pybullet.getOverlappingObjects(low, high, physicsClientId=self.client) or ():
            if body == own_body or (own_body is None and body in self.drone_ids):
                continue
            points: Any = pybullet.getClosestPoints(
                body,
                -1,
                horizon_m,
                collisionShapeA=-1,
                collisionShapeB=probe,
                collisionShapePositionB=at_m.tolist(),
                physicsClientId=self.client,
            )
            nearest = min([nearest, *(point[8] for point in points)])
        return min(horizon_m, float(nearest) + probe_radius_m - radius_m)

    def _probe(self, radius_m: float) -> int:
        """A collision sphere without a body, for distance queries."""
        if radius_m not in self._probes:
            self._probes[radius_m] = pybullet.createCollisionShape(
                pybullet.GEOM_SPHERE, radius=radius_m, physicsClientId=self.client
            )
        return self._probes[radius_m]

    def _refuse_bad_starts(self) -> None:
        pybullet.performCollisionDetection(physicsClientId=self.client)
        for drone in range(self.n_drones):
            room = self.clearance_m(drone, 1.0)
            if room <= 0:
                x, y, z = self._position[drone]
                raise SceneError(
                    f"drone {drone} starts at ({x:.2f}, {y:.2f}, {z:.2f}) m in touch with another body; "
                    "move the start or spread the formation"
                )
