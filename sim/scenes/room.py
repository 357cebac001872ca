"""A furnished room: weakly textured walls, a table, chairs and screens of slats, a shelf, and boxes."""

from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from voxdepth.arithmetic import matmul
from voxdepth.types import FloatArray

from .. import frames
from ..bodies import Body, Box, Scene, SceneSpec, Surface
from ..seeds import Purpose, stream
from .layout import flat_ground

WALLS, BOXES, CHAIRS, SCREENS = range(4)
"""Keys of random streams."""
LENGTH_M, WIDTH_M, HEIGHT_M = 5.0, 4.5, 2.6
"""Extent of the room along x, y and z."""
WALL_DEPTH_M = 0.2
PATH_START_M, PATH_M = 0.6, 1.2
"""The path leads along x from its start, at y = 0."""
TABLE_AT_M, TABLE_M, TABLE_HEIGHT_M, BOARD_M, LEG_M = 2.6, (0.7, 1.5), 0.72, 0.04, 0.05
SHELF_AT_M, SHELF_M, SHELF_BOARDS_M = 3.2, (1.6, 0.35), (0.5, 0.95, 1.4, 1.85)
SEAT_M, SEAT_HEIGHT_M, BACK_M = 0.42, 0.45, 0.5
CHAIR_AT_M, SCREEN_AT_M = (1.95, 2.15), (3.2, 3.8)
SLAT_M, SLAT_DEPTH_M, SLAT_GAP_M = 0.02, 0.015, 0.013
"""Width and depth of a slat, and the gap to the next one; the background in narrow gaps is hard to measure."""

Part = tuple[tuple[float, float, float], tuple[float, float, float]]
"""Sides of a box, and its centre relative to the point on the floor where the furniture stands [m]."""


class RoomSpec(SceneSpec):
    """A room of 5 by 4.5 metres; the path leads from its front towards the table. A camera needs at most 2 m height."""

    kind: Literal["room"] = "room"
    wall_texture: float = Field(default=0.15, ge=0)
    """Strength of the texture of walls, ceiling and floor; a stereo camera cannot match them at 0."""
    wall_gloss: float = Field(default=0.0, ge=0, le=1)
    """Share of walls, ceiling and floor that returns no light of a projector."""
    boxes: int = Field(default=14, ge=0, le=5_000)
    """Boxes on the table, on the shelf and on the floor."""
    dark_share: float = Field(default=0.15, ge=0, le=1)
    """Probability that a box is nearly black."""
    glossy_share: float = Field(default=0.2, ge=0, le=1)
    """Probability that a box is glossy."""
    chairs: int = Field(default=2, ge=0, le=3)
    """Chairs before the table, with backs of slats."""
    screens: int = Field(default=0, ge=0, le=3)
    """Screens of slats before the far wall."""

    @model_validator(mode="after")
    def _check(self) -> "RoomSpec":
        if self.dark_share + self.glossy_share > 1:
            raise ValueError(f"dark_share and glossy_share exclude each other: {self.dark_share} + {self.glossy_share}")
        return self

    def build(self, seed: int) -> Scene:
        """Return the room of a seed: it begins at x = 0 and is centred on y = 0."""
        rng = stream(seed, Purpose.SCENE, WALLS)
        plain = Surface(albedo=0.4, texture=self.wall_texture, pattern="ground", gloss=self.wall_gloss)
        floor = flat_ground(LENGTH_M / 2, plain)
        wood = Surface(albedo=rng.uniform(0.3, 0.6), texture=0.5, pattern="bark")
        bodies = (
            floor,
            *_walls(self, rng),
            *assembled("table", _table(), (TABLE_AT_M, 0.0), 0.0, wood),
            *assembled("shelf", _shelf(), (SHELF_AT_M, WIDTH_M / 2 - SHELF_M[1] / 2), 0.0, wood),
            *(part for i in range(self.chairs) for part in _chair(self, seed, i)),
            *(part for i in range(self.screens) for part in _screen(self, seed, i)),
            *(_box(self, seed, i) for i in range(self.boxes)),
        )
        path_m = np.array([[PATH_START_M, 0.0, 0.0], [PATH_START_M + PATH_M, 0.0, 0.0]])
        return Scene(seed=seed, bodies=bodies, weather=self.weather, path_m=path_m)


def assembled(name: str, parts: list[Part], at_m: tuple[float, float], yaw_rad: float, surface: Surface) -> list[Body]:
    """Return furniture of boxes, a body each, that stands on the floor.

    Args:
        name: Name of the furniture; those of the bodies count on from `name-0`.
        parts: Sizes and centres of the boxes, in the frame of the furniture.
        at_m: Position (x, y) in the world frame.
        yaw_rad: Rotation about the vertical, from the world's x axis towards y.
        surface: Appearance of all boxes.
    """
    rotation = frames.rotation_from_yaw(yaw_rad)
    bodies = []
    for k, (size_m, center_m) in enumerate(parts):
        x, y, z = np.add(matmul(rotation, np.array(center_m)), (*at_m, 0.0)).tolist()
        body = Body(name=f"{name}-{k}", shape=Box(size_m), position_m=(x, y, z), yaw_rad=yaw_rad, surface=surface)
        bodies.append(body)
    return bodies


def slats(width_m: float, low_m: float, high_m: float, *, upright: bool) -> list[Part]:
    """Return a frame of slats around x = 0, as its parts.

    Args:
        width_m: Extent along y, half on each side of 0.
        low_m: Height of the low edge.
        high_m: Height of the high edge.
        upright: Whether the slats are upright, rather than level.
    """
    pitch_m = SLAT_M + SLAT_GAP_M
    across_m, height_m = width_m - 2 * LEG_M, high_m - low_m - 2 * LEG_M
    n = int(((across_m if upright else height_m) - SLAT_GAP_M) / pitch_m)
    centers_m = pitch_m * (np.arange(n) - (n - 1) / 2)
    middle_m = (low_m + high_m) / 2
    parts: list[Part] = [((LEG_M, LEG_M, high_m - low_m), (0.0, y, middle_m)) for y in _ends(width_m)]
    parts += [((LEG_M, across_m, LEG_M), (0.0, 0.0, z)) for z in (low_m + LEG_M / 2, high_m - LEG_M / 2)]
    if upright:
        return parts + [((SLAT_DEPTH_M, SLAT_M, height_m), (0.0, y, middle_m)) for y in centers_m.tolist()]
    return parts + [((SLAT_DEPTH_M, across_m, SLAT_M), (0.0, 0.0, middle_m + z)) for z in centers_m.tolist()]


def _ends(length_m: float) -> tuple[float, float]:
    return -(length_m - LEG_M) / 2, (length_m - LEG_M) / 2


def _walls(spec: RoomSpec, rng: np.random.Generator) -> list[Body]:
    """Return walls around the room, and a ceiling on top of them."""
    depth_m, length_m, width_m, height_m = WALL_DEPTH_M, LENGTH_M, WIDTH_M, HEIGHT_M
    parts: list[Part] = [((depth_m, width_m, height_m), (x, 0, height_m / 2)) for x in (-depth_m / 2, length_m + 0.1)]
    beside_m = (width_m + depth_m) / 2
    parts += [((length_m, depth_m, height_m), (length_m / 2, y, height_m / 2)) for y in (-beside_m, beside_m)]
    parts.append(((length_m, width_m, depth_m), (length_m / 2, 0, height_m + depth_m / 2)))
    surface = Surface(albedo=rng.uniform(0.45, 0.65), texture=spec.wall_texture, gloss=spec.wall_gloss)
    return assembled("wall", parts, (0.0, 0.0), 0.0, surface)


def _table() -> list[Part]:
    top_m = TABLE_HEIGHT_M - BOARD_M
    legs: list[Part] = [
        ((LEG_M, LEG_M, top_m), (x, y, top_m / 2)) for x in _ends(TABLE_M[0]) for y in _ends(TABLE_M[1])
    ]
    return [((*TABLE_M, BOARD_M), (0.0, 0.0, TABLE_HEIGHT_M - BOARD_M / 2)), *legs]


def _shelf() -> list[Part]:
    high_m = SHELF_BOARDS_M[-1]
    sides: list[Part] = [((BOARD_M, SHELF_M[1], high_m), (x, 0.0, high_m / 2)) for x in _ends(SHELF_M[0])]
    return [*sides, *(((*SHELF_M, BOARD_M), (0.0, 0.0, z - BOARD_M / 2)) for z in SHELF_BOARDS_M)]


def _chair(spec: RoomSpec, seed: int, index: int) -> list[Body]:
    """Return a chair with its back towards the start of the path; the slats of every other one are level."""
    rng = stream(seed, Purpose.SCENE, CHAIRS, index)
    legs: list[Part] = [
        ((LEG_M, LEG_M, SEAT_HEIGHT_M), (x + SEAT_M / 2, y, SEAT_HEIGHT_M / 2))
        for x in _ends(SEAT_M) for y in _ends(SEAT_M)
    ]  # fmt: skip
    seat: Part = ((SEAT_M, SEAT_M, BOARD_M), (SEAT_M / 2, 0.0, SEAT_HEIGHT_M + BOARD_M / 2))
    low_m = SEAT_HEIGHT_M + BOARD_M
    back = slats(SEAT_M, low_m, low_m + BACK_M, upright=index % 2 == 0)
    y = 0.72 * (index - (spec.chairs - 1) / 2) + rng.uniform(-0.1, 0.1)
    surface = Surface(albedo=rng.uniform(0.2, 0.6), texture=0.6, pattern="bark")
    at_m = (rng.uniform(*CHAIR_AT_M), y)
    return assembled(f"chair-{index}", [*legs, seat, *back], at_m, np.radians(rng.uniform(-20, 20)), surface)


def _screen(spec: RoomSpec, seed: int, index: int) -> list[Body]:
    rng = stream(seed, Purpose.SCENE, SCREENS, index)
    y = 1.1 * (index - (spec.screens - 1) / 2) + rng.uniform(-0.05, 0.05)
    surface = Surface(albedo=rng.uniform(0.2, 0.6), texture=0.6, pattern="bark")
    parts = slats(1.0, 0.0, rng.uniform(1.5, 1.9), upright=index % 2 == 0)
    at_m = (rng.uniform(*SCREEN_AT_M), y)
    return assembled(f"screen-{index}", parts, at_m, np.radians(rng.uniform(-10, 10)), surface)


def _box(spec: RoomSpec, seed: int, index: int) -> Body:
    """Return a box on the table, on the shelf or on the floor, in turn."""
    rng = stream(seed, Purpose.SCENE, BOXES, index)
    depth_m, width_m, height_m = rng.uniform(0.08, 0.3, 3).tolist()
    half_m = np.array(TABLE_M) / 2 - 0.15
    on_table = rng.uniform(-half_m, half_m) + np.array([TABLE_AT_M, 0.0])
    on_shelf = np.array([SHELF_AT_M + rng.uniform(-0.6, 0.6), WIDTH_M / 2 - 0.2])
    on_floor = np.array([rng.uniform(2.2, LENGTH_M - 0.4), -rng.uniform(0.9, WIDTH_M / 2 - 0.3)])
    board_m = float(rng.choice(SHELF_BOARDS_M))
    support: tuple[FloatArray, float] = ((on_table, TABLE_HEIGHT_M), (on_shelf, board_m), (on_floor, 0.0))[index % 3]
    (x, y), low_m = support[0].tolist(), support[1]
    kind = rng.uniform()
    dark, glossy = kind < spec.dark_share, kind > 1 - spec.glossy_share
    albedo = 0.03 if dark else rng.uniform(0.25, 0.8)
    surface = Surface(albedo=albedo, texture=rng.uniform(0.2, 1.0), gloss=0.6 if glossy else 0.0)
    shape = Box((depth_m, width_m, height_m))
    at_m = (x, y, low_m + height_m / 2)
    return Body(name=f"box-{index}", shape=shape, position_m=at_m, yaw_rad=rng.uniform(-np.pi, np.pi), surface=surface)
