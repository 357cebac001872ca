"""Frames of any kind: a corrector refuses one in a clear line and goes on, or gives depth that anybody can use.

A few streams are tried with every run of the tests. `make fuzz EXAMPLES=20000 SEED=7` tries more of them.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import hypothesis
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from voxdepth.errors import VoxDepthError
from voxdepth.registry import create_corrector, installed_names
from voxdepth.types import CorrectedDepth, DepthCorrector, Frame, Intrinsics, Source

EXAMPLES = int(os.environ.get("VOXDEPTH_FUZZ_EXAMPLES") or 750)
SEED = int(os.environ.get("VOXDEPTH_FUZZ_SEED") or 0)


def require_clear(error: BaseException) -> None:
    """Require that an error says something, in one line."""
    message = str(error)
    assert message.strip() and "\n" not in message and len(message) < 20_000, f"{type(error).__name__}: {message!r}"


def read_only(image: np.ndarray) -> np.ndarray:
    image.setflags(write=False)
    return image


def unaligned(image: np.ndarray) -> np.ndarray:
    if image.dtype.hasobject:
        return image
    return np.frombuffer(b"x" + image.tobytes(), np.uint8)[1:].view(image.dtype).reshape(image.shape)


LAYOUTS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "C": np.ascontiguousarray,
    "Fortran": np.asfortranarray,
    "transposed": lambda image: np.ascontiguousarray(image.T).T,
    "strided": lambda image: np.repeat(np.repeat(image, 2, axis=0), 3, axis=1)[::2, ::3],
    "backwards": lambda image: np.ascontiguousarray(image[::-1, ::-1])[::-1, ::-1],
    "rot90": lambda image: np.rot90(np.ascontiguousarray(np.rot90(image)), -1),
    "read only": read_only,
    "unaligned": unaligned,
    "repeated": lambda image: np.broadcast_to(image[:1], image.shape),
    "big endian": lambda image: image.astype(image.dtype.newbyteorder(">")),
    "masked": lambda image: np.ma.masked_equal(image, image.flat[0]),
    "masked nowhere": np.ma.asarray,
    "matrix": lambda image: image.view(Subclass),
    "list": lambda image: image.tolist(),
    "3 channels": lambda image: np.dstack([image] * 3),
    "flat": np.ravel,
    "empty": lambda image: image[:0],
}
USUAL = ("C", "Fortran", "transposed", "strided", "backwards", "rot90", "read only")
ODD_DEPTHS = (np.nan, np.inf, -np.inf, -1.0, -0.0, 1e-45, 1e-38, 1e-20, 1e-3, 65.535, 1e6, 1e20, 3.4e38, 1e39, 1e300)
DTYPES = (
    "float32",
    "float64",
    "uint16",
    "float16",
    "int32",
    "uint8",
    "bool",
    "complex64",
    "object",
    "str",
    "datetime64[s]",
)
SIDES = (1, 2, 3, 5, 8, 9, 13, 16, 24, 31, 32, 48, 64, 96)


class Subclass(np.ndarray):
    """An array of another type, as libraries for units have."""


class Given(NamedTuple):
    """One measurement as a stranger passes it."""

    make: Callable[..., Frame]
    arguments: dict[str, Any]


@dataclass(frozen=True)
class Stream:
    """A corrector, its camera, and what is passed to it."""

    corrector: str
    camera: Intrinsics
    frames: Sequence[Given]


def textured(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """A gray image: noise, one value, a ramp or squares."""
    rows, columns = np.indices(shape)
    images = (
        rng.integers(0, 256, shape),
        np.full(shape, rng.integers(0, 256)),
        rows * 255 // shape[0],
        255 * ((rows // 4 + columns // 4) % 2),
    )
    return images[rng.integers(len(images))].astype(np.uint8)


def depths(rng: np.random.Generator, shape: tuple[int, int], odd: Sequence[float]) -> np.ndarray:
    """Depth of 64 bits with holes and a share of odd values; where they are is random, in rows, or everywhere."""
    depth_m = np.full(shape, rng.uniform(0.3, 40.0)) if rng.random() < 0.5 else rng.uniform(0.3, 40.0, shape)
    depth_m[rng.random(shape) < rng.choice([0.0, 0.1, 0.9, 1.0])] = 0
    for value in odd:
        where = rng.random(shape) < rng.choice([0.02, 0.5, 1.0], p=[0.7, 0.2, 0.1])
        depth_m[where] = value
    return depth_m


@st.composite
def cameras(draw: st.DrawFn) -> Intrinsics:
    """Cameras of every size and lens that `Intrinsics` accepts; most are small and usual."""
    width_px, height_px = draw(st.sampled_from(SIDES)), draw(st.sampled_from(SIDES))
    if draw(st.integers(0, 39)) == 0:
        width_px, height_px = draw(st.sampled_from([(640, 8), (4000, 9), (7, 3000), (2048, 64), (640, 480)]))
    longest_px = max(width_px, height_px)
    focal_px = st.sampled_from(
        [longest_px, longest_px, longest_px, 0.3 * longest_px, 0.051 * longest_px, 1000.0 * longest_px]
    )
    middle = st.sampled_from([0.5, 0.5, 0.5, 0.0, 1.0, -0.5, 1.5])
    return Intrinsics(
        fx_px=draw(focal_px), fy_px=draw(focal_px),
        cx_px=width_px * draw(middle), cy_px=height_px * draw(middle),
        width_px=width_px, height_px=height_px,
        baseline_m=draw(st.sampled_from([0.05, 0.1, 0.1, None, 1e-3, 10.0])),
        disparity_scale=draw(st.sampled_from([1.0, 1.0, 3.0, 1e-3, 1e3])),
    )  # fmt: skip


POSES = (
    None, np.eye(4), np.eye(4, dtype=np.float32), np.eye(4)[:3], 2 * np.eye(4), np.full((4, 4), np.nan), -np.eye(4),
    np.diag([1.0, 1.0, -1.0, 1.0]), np.eye(4).tolist(), "pose", np.eye(4, dtype=object), np.eye(4) * 1j,
    np.eye(4) + 1e300 * np.eye(4, k=3), np.eye(4) + 1e30 * np.eye(4, k=3), np.ma.masked_equal(np.eye(4), 0),
)  # fmt: skip
STEPS = (0.0, -1.0, 1e-9, 1e300, np.nan, np.inf, -np.inf, None, "now", 10**400, 1j, np.float32(1), np.datetime64("now"))


@st.composite
def given_frames(draw: st.DrawFn, shape: tuple[int, int], now_s: float) -> Given:
    """A frame that is usual but for a few of its properties."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    odd = draw(st.sets(st.sampled_from(["size", "stamp", "gray", "depth", "dtype", "values", "pose"]), max_size=2))
    if "size" in odd:
        shape = (draw(st.sampled_from(SIDES)), draw(st.sampled_from(SIDES)))
    any_layout, usual_layout = st.sampled_from(sorted(LAYOUTS)), st.sampled_from(USUAL)
    make, unit = draw(st.sampled_from([("", 1.0), ("", 1.0), ("from_metres", 1.0), ("from_millimetres", 1000.0)]))
    values = draw(st.lists(st.sampled_from(ODD_DEPTHS), min_size=1, max_size=2)) if "values" in odd else []
    if not make and draw(st.booleans()):
        values = [value for value in values if 0 <= value <= 3.4e38]
    usual_dtype = {
        "": "float32",
        "from_metres": draw(st.sampled_from(["float32", "float64"])),
        "from_millimetres": "uint16",
    }
    dtype = draw(st.sampled_from(DTYPES)) if "dtype" in odd else usual_dtype[make]
    depth = as_dtype(unit * depths(rng, shape, values), dtype)
    gray = as_dtype(
        textured(rng, shape), draw(st.sampled_from(DTYPES)) if "dtype" in odd and rng.random() < 0.5 else "uint8"
    )
    arguments = {
        "stamp_s": draw(st.sampled_from(STEPS)) if "stamp" in odd else now_s,
        "gray": LAYOUTS[draw(any_layout if "gray" in odd else usual_layout)](gray),
        "depth_mm" if make == "from_millimetres" else "depth_m": LAYOUTS[
            draw(any_layout if "depth" in odd else usual_layout)
        ](depth),
        "T_world_cam": draw(st.sampled_from(POSES)) if "pose" in odd else None,
    }
    return Given(getattr(Frame, make) if make else Frame, arguments)


def as_dtype(values: np.ndarray, dtype: str) -> np.ndarray:
    with np.errstate(all="ignore"):
        return np.nan_to_num(values).astype(dtype) if np.dtype(dtype).kind in "iubM" else values.astype(dtype)


@st.composite
def streams(draw: st.DrawFn) -> Stream:
    camera = draw(cameras())
    start_s = draw(st.sampled_from([0.0, 0.0, 0.0, -5.0, 1.7e9, 1e15, -1e300]))
    count = draw(st.integers(1, 4))
    frames = [draw(given_frames(camera.shape, start_s + k / 30)) for k in range(count)]
    return Stream(draw(st.sampled_from(installed_names())), camera, frames)


def content(value: Any) -> Any:
    """What is compared to see whether an argument changed, bit by bit, with what its mask hides."""
    if isinstance(value, np.ma.MaskedArray):
        return content(value.data), content(np.ma.getmaskarray(value))
    return value.tobytes() if isinstance(value, np.ndarray) else repr(value)


def require_usable(corrected: CorrectedDepth, frame: Frame) -> None:
    shape = frame.depth_m.shape
    for image, dtype in (
        (corrected.depth_m, "float32"),
        (corrected.source, "uint8"),
        (corrected.confidence, "float32"),
    ):
        assert isinstance(image, np.ndarray) and image.shape == shape and image.dtype == np.dtype(dtype)
        assert not np.may_share_memory(image, frame.depth_m) and not np.may_share_memory(image, frame.gray)
    assert np.isfinite(corrected.depth_m).all() and (corrected.depth_m >= 0).all()
    assert ((corrected.confidence >= 0) & (corrected.confidence <= 1)).all()
    assert corrected.source.max() <= max(Source)
    np.testing.assert_array_equal(corrected.depth_m > 0, corrected.source != Source.INVALID)
    assert not corrected.confidence[corrected.depth_m == 0].any()


def bits(corrected: CorrectedDepth) -> tuple[bytes, bytes, bytes]:
    return corrected.depth_m.tobytes(), corrected.source.tobytes(), corrected.confidence.tobytes()


def fed(corrector: DepthCorrector, given: Given) -> tuple[Frame, CorrectedDepth] | None:
    """Pass a frame to a corrector; None if it was refused as documented.

    Types and values of arguments are refused where a frame is made. A corrector raises only a `VoxDepthError`.
    """
    before = {name: content(value) for name, value in given.arguments.items()}
    try:
        try:
            frame = given.make(**given.arguments)
        except (TypeError, ValueError) as error:
            require_clear(error)
            return None
        return frame, corrector.process(frame)
    except VoxDepthError as error:
        require_clear(error)
        return None
    finally:
        assert {name: content(value) for name, value in given.arguments.items()} == before, "the input was changed"


@pytest.mark.filterwarnings("ignore:the median of depth_m is")
@pytest.mark.slow
@hypothesis.seed(SEED)
@settings(
    max_examples=EXAMPLES,
    deadline=None,
    derandomize=False,
    database=None,
    print_blob=True,
    suppress_health_check=list(HealthCheck),
    phases=(Phase.explicit, Phase.generate, Phase.shrink),
)
@given(streams())
def test_a_stream_is_corrected_and_refused_frames_leave_no_trace(stream: Stream) -> None:
    try:
        corrector = create_corrector(stream.corrector, stream.camera)
    except VoxDepthError as error:
        return require_clear(error)
    accepted, refused = [], False
    for one in stream.frames:
        done = fed(corrector, one)
        if done is None:
            refused = True
        else:
            require_usable(done[1], done[0])
            accepted.append(done)
    if refused and accepted:
        alone = create_corrector(stream.corrector, stream.camera)
        assert [bits(alone.process(frame)) for frame, _ in accepted] == [bits(result) for _, result in accepted]
