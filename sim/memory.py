"""NumPy memory for Warp kernels on a CPU."""

from typing import Any

import numpy.typing as npt
import warp as wp


def on_cpu(array: npt.NDArray[Any], dtype: Any) -> Any:
    """A contiguous NumPy array as a Warp array over the same memory."""
    return wp.array(array, dtype=dtype, copy=False, device="cpu")
