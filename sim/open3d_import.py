"""The only way to Open3D: its wheel needs libusb, which many machines lack."""

import ctypes
from functools import cache
from typing import Any

from .errors import RenderError


@cache
def open3d() -> Any:
    """The `open3d` module, after loading libusb from the `libusb-package` wheel (no root needed).

    Raises:
        RenderError: Open3D cannot be imported here.
    """
    try:
        import libusb_package

        ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
        import open3d as module
    except (ImportError, OSError) as error:
        raise RenderError(
            f"the raycast renderer needs Open3D, which does not load here ({error}); install the extra 'sim', "
            "or use the renderer 'tiny'"
        ) from error
    return module
