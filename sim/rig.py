"""The stereo cameras of all drones of a world."""

from collections.abc import Iterator, Sequence

from .cpu import Mapper
from .sensor import RigConfig, StereoSensor
from .types import BodyPose, Capture, Renderer, Viewpoint
from .world import World


class StereoRig:
    """Makes captures of the stereo cameras that the drones of a world carry.

    Args:
        world: The world.
        renderer: A renderer of the same world.
        config: Configuration of every camera.
        seed: Master seed of all noise.
        gray: Whether gray images are wanted; without them they are black, unless the sensor model needs them.
        pool_map: Map over the drones; one with several threads gives the same captures sooner.
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
        """One capture for each of the named drones in their order, all at the present time of the world.

        The images are rendered at once. Noise and depth are computed when a capture is consumed, or ahead of that by
        the threads of `pool_map`.

        Args:
            drones: Indices of drones.
            frame: Number of the frame; noise is keyed by drone and frame.
        """
        states = self._world.states
        viewpoints = [
            Viewpoint(
                drone=drone,
                pose=BodyPose(
                    stamp_s=self._world.time_s,
                    position_m=states[drone].position_m,
                    q_world_body_xyzw=states[drone].q_world_body_xyzw,
                ),
            )
            for drone in drones
        ]
        return self._map(self._sensor.capture, self._sensor.render(viewpoints, frame))
