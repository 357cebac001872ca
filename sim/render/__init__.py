"""Renderers: interchangeable ways to see a `World`."""

from collections.abc import Callable
from typing import Literal

from ..errors import RenderError
from ..types import Renderer
from ..world import World


def _raycast(world: World, threads: int) -> Renderer:
    from .raycast import RayCaster
    from .shaded import ShadedRenderer

    return ShadedRenderer(world, RayCaster, threads=threads)


def _raster(world: World, threads: int) -> Renderer:
    from .raster import Rasteriser
    from .shaded import ShadedRenderer

    return ShadedRenderer(world, Rasteriser, threads=threads)


def _tiny(world: World, threads: int) -> Renderer:
    from .bullet import TinyRenderer

    return TinyRenderer(world)


def _egl(world: World, threads: int) -> Renderer:
    from .bullet import EglRenderer

    return EglRenderer(world)


RendererName = Literal["raster", "raycast", "tiny", "egl"]

_FACTORIES: dict[str, Callable[[World, int], Renderer]] = {
    "raster": _raster,
    "raycast": _raycast,
    "tiny": _tiny,
    "egl": _egl,
}

RENDERER_NAMES = tuple(_FACTORIES)


def create_renderer(name: str, world: World, *, threads: int = 2) -> Renderer:
    """A renderer of that name for one world; `threads` changes its speed alone.

    Raises:
        RenderError: No renderer has that name, or it does not work on this machine.
    """
    if name not in _FACTORIES:
        raise RenderError(f"there is no renderer {name!r}; choose one of: {', '.join(RENDERER_NAMES)}")
    return _FACTORIES[name](world, threads)
