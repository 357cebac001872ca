"""The stereo cameras of the drones of a world."""

from collections.abc import Iterator, Sequence

from .parallel import Mapper
from .sensor import RigConfig, StereoSensor, Viewpoint
from .types import BodyPose, Capture, DroneState, Renderer
from .world import World


class StereoRig:
    """Captures what the stereo cameras of drones see.

    Args:
        world: Whose drones carry the cameras.
        renderer: Made for the same world.
        config: Of every camera.
        seed: Master seed of all noise.
        gray: Whether the gray images are wanted; without them they are black, unless the sensor model needs them.
        pool_map: Makes the captures of several drones side by side; the result is the same with any.
    """

    def __init__(
        self,
        world: World,
        renderer: Renderer,
        config: RigConfig,
        *,
        seed: int,
        gray: bool = True,
        pool_map: Mapper = map,
    ) -> None:
        self._world = world
        self._sensor = StereoSensor(world, renderer, config, seed=seed, gray=gray)
        self._map = pool_map
        self.intrinsics = self._sensor.intrinsics
        self.mount_m = config.left_mount_m

    def capture(self, drones: Sequence[int], frame: int) -> Iterator[Capture]:
        """One capture for each of the named drones in their order, all at the world's present time.

        Each is made when it is asked for; with threads, the next ones are made meanwhile.

        Args:
            drones: Indices of drones.
            frame: Number of the frame; noise is keyed by drone and frame.
        """
        states = self._world.states
        pairs = self._sensor.render([self._viewpoint(drone, states[drone]) for drone in drones], frame)
        return self._map(self._sensor.capture, pairs)

    def _viewpoint(self, drone: int, state: DroneState) -> Viewpoint:
        pose = BodyPose(
            stamp_s=self._world.time_s, position_m=state.position_m, q_world_body_xyzw=state.q_world_body_xyzw
        )
        return Viewpoint(drone=drone, pose=pose)
