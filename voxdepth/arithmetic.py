"""Arithmetic that gives the same bytes on every processor.

BLAS multiplies matrices, and NumPy computes sines, exponentials and powers of arrays, with the instructions that a
processor has, and rounds in another way with each set of them. In a state that feeds back, a pose for example, such
differences grow. The functions here add in the order of the indices, and call the C library number by number.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from numba import float32, float64, types, void

from .compiled import READABLE_IMAGE, READABLE_MATRIX, compiled
from .types import FloatArray

_LINE = types.Array(float64, 1, "C", readonly=True)


def matmul(a: npt.NDArray[Any], b: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the product of `a`, shape (..., K), and `b`, shape (K,) or (K, M): shape (...,) or (..., M).

    It is computed in the precision of `a`, float32 or else float64; `b` is converted to it.
    """
    multiply, kind = (_multiply_32, np.float32) if a.dtype == np.float32 else (_multiply_64, np.float64)
    left: npt.NDArray[Any] = np.ascontiguousarray(a, kind).reshape(math.prod(a.shape[:-1]), a.shape[-1])
    right: npt.NDArray[Any] = np.ascontiguousarray(b, kind).reshape(len(b), math.prod(b.shape[1:]))
    if left.shape[1] != len(right):
        raise ValueError(f"expected as many rows of b as columns of a, got shapes {a.shape} and {b.shape}")
    product: npt.NDArray[Any] = np.zeros((len(left), right.shape[1]), kind)
    multiply(left, right, product)
    return product.reshape(a.shape[:-1] + b.shape[1:])


def length(vector: FloatArray) -> float:
    """Return the Euclidean length of a vector of few numbers."""
    return math.hypot(*vector.tolist())


def sin(angle_rad: npt.ArrayLike) -> FloatArray:
    """Return the sine of every angle [rad], same shape."""
    return _of_each(_sin, angle_rad)


def cos(angle_rad: npt.ArrayLike) -> FloatArray:
    """Return the cosine of every angle [rad], same shape."""
    return _of_each(_cos, angle_rad)


def exp(exponent: npt.ArrayLike) -> FloatArray:
    """Return the exponential of every number, same shape."""
    return _of_each(_exp, exponent)


def log(number: npt.ArrayLike) -> FloatArray:
    """Return the natural logarithm of every positive number, same shape."""
    return _of_each(_log, number)


@contextmanager
def without_ipp() -> Iterator[None]:
    """Keep OpenCV from calling Intel's IPP in this thread, which rounds differently on each processor."""
    used = cv2.ipp.useIPP()
    cv2.ipp.setUseIPP(False)
    try:
        yield
    finally:
        cv2.ipp.setUseIPP(used)


def _of_each(function: Callable[[FloatArray, FloatArray], None], argument: npt.ArrayLike) -> FloatArray:
    arguments = np.ascontiguousarray(argument, np.float64)
    values = np.empty_like(arguments)
    function(arguments.reshape(-1), values.reshape(-1))
    return values.reshape(np.shape(argument))


@compiled(void(READABLE_MATRIX, READABLE_MATRIX, float64[:, ::1]))
def _multiply_64(a: FloatArray, b: FloatArray, product: FloatArray) -> None:
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            for j in range(b.shape[1]):
                product[i, j] += a[i, k] * b[k, j]


@compiled(void(READABLE_IMAGE, READABLE_IMAGE, float32[:, ::1]))
def _multiply_32(a: FloatArray, b: FloatArray, product: FloatArray) -> None:
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            for j in range(b.shape[1]):
                product[i, j] += a[i, k] * b[k, j]


@compiled(void(_LINE, float64[::1]))
def _sin(argument: FloatArray, value: FloatArray) -> None:
    for k in range(len(argument)):
        value[k] = math.sin(argument[k])


@compiled(void(_LINE, float64[::1]))
def _cos(argument: FloatArray, value: FloatArray) -> None:
    for k in range(len(argument)):
        value[k] = math.cos(argument[k])


@compiled(void(_LINE, float64[::1]))
def _exp(argument: FloatArray, value: FloatArray) -> None:
    for k in range(len(argument)):
        value[k] = math.exp(argument[k])


@compiled(void(_LINE, float64[::1]))
def _log(argument: FloatArray, value: FloatArray) -> None:
    for k in range(len(argument)):
        value[k] = math.log(argument[k])
