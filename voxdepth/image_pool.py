"""Memory for images that are results: it is used again when nobody holds the image any more."""

import weakref
from typing import Generic, TypeVar

import numpy as np
import numpy.typing as npt

MAX_FREE = 4
"""Images whose memory is kept for later ones."""

Scalar = TypeVar("Scalar", bound=np.generic)


class ImagePool(Generic[Scalar]):
    """Lends images of one shape and type.

    The system provides new memory page by page at its first use, which takes longer than to fill an image: of the
    default method's 7.3 ms for a frame of 640 x 480 it would be one more.
    """

    def __init__(self, shape: tuple[int, ...], dtype: type[Scalar]) -> None:
        self._shape = shape
        self._dtype = dtype
        self._free: list[npt.NDArray[Scalar]] = []

    def image(self) -> npt.NDArray[Scalar]:
        """An image without values yet."""
        memory = self._free.pop() if self._free else np.empty(self._shape, self._dtype)
        # The base of the image and of all its views, since that of this array is none.
        flat = np.frombuffer(memory.data, self._dtype)
        weakref.finalize(flat, self._take_back, memory)
        return flat.reshape(self._shape)

    def _take_back(self, memory: npt.NDArray[Scalar]) -> None:
        if len(self._free) < MAX_FREE:
            self._free.append(memory)
