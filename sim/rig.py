"""The stereo cameras of all drones of a world."""

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

from .cpu import Mapper
from .sensor import RigConfig, StereoSensor
from .types import Capture, Renderer
from .world import World

T = TypeVar("T")


class StereoRig:
    """Makes captures of the stereo cameras that the drones of a world carry; see `StereoSensor`.

    `pool_map` maps over the drones; a map with several threads gives the same captures sooner.
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
        """One capture for each of the drones, all at the present time of the world.

        The images are rendered at once. Noise and depth are computed when a capture is consumed, or ahead of that by
        the threads of `pool_map`. Noise is keyed by drone and frame.
        """
        return self.capture_and(lambda capture: capture, drones, frame)

    def capture_and(self, process: Callable[[Capture], T], drones: Sequence[int], frame: int) -> Iterator[T]:
        """The results of a function of each of these captures; several threads may call it for different drones."""
        pairs = self._sensor.render([self._world.pose(drone) for drone in drones], frame)
        return self._map(lambda pair: process(self._sensor.capture(pair)), pairs)
