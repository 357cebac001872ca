"""Interchangeable renderers of a `World`."""

from typing import Literal, get_args

from ..errors import RenderError
from ..types import Renderer
from ..world import World

RendererName = Literal["raster", "raycast", "tiny", "egl"]
RENDERER_NAMES: tuple[RendererName, ...] = get_args(RendererName)


def create_renderer(name: str, world: World, *, threads: int = 2) -> Renderer:
    """Return the renderer with a name, for one world. The number of threads changes only its speed.

    A name that no renderer has, or a renderer that does not work on this machine, raises a `RenderError`.
    """
    if name in ("raster", "raycast"):
        from .raster import Rasteriser
        from .raycast import RayCaster
        from .shaded import ShadedRenderer

        return ShadedRenderer(world, Rasteriser if name == "raster" else RayCaster, threads=threads)
    if name in ("tiny", "egl"):
        from .bullet import EglRenderer, TinyRenderer

        return TinyRenderer(world) if name == "tiny" else EglRenderer(world)
    raise RenderError(f"there is no renderer {name!r}; choose one of: {', '.join(RENDERER_NAMES)}")
