"""The example that trains the network of `learned`: samples are what the truth says, and `retrained` is found."""

import shutil
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.baseline_frames import camera, frame, scene, texture
from tests.plugins import offer
from voxdepth.errors import ConfigError
from voxdepth.networks import FOLDER, has_runtime
from voxdepth.registry import create_bare, create_corrector, latency_s
from voxdepth.types import Frame, Intrinsics

SHAPE = (96, 128)
WALL_M = 4.0
CAMERA = Intrinsics(
    fx_px=100.0, fy_px=100.0, cx_px=64.0, cy_px=48.0, width_px=SHAPE[1], height_px=SHAPE[0], baseline_m=0.1
)

needs_runtime = pytest.mark.skipif(not has_runtime(), reason="needs the extra learned")


@pytest.fixture(autouse=True)
def _installed(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    offer("learned", tmp_path_factory.mktemp("site"), monkeypatch)


@pytest.fixture
def sample() -> Any:
    """Of a camera that moves along a textured wall by a pixel a frame, with a hole in its depth and sky above."""
    wall = np.random.default_rng(0).integers(0, 255, (SHAPE[0], SHAPE[1] + 10)).astype(np.uint8)
    true_m = np.full((10, *SHAPE), WALL_M, np.float32)
    raw_m = true_m.copy()
    raw_m[:, 20:40, 30:60] = 0
    true_m[:, :4] = np.inf
    frames = [Frame(stamp_s=k / 30, gray=wall[:, k : k + SHAPE[1]], depth_m=depth_m) for k, depth_m in enumerate(raw_m)]
    return import_module("learned_plugin.samples").Sample.of(frames, true_m, CAMERA)


def test_a_sample_is_the_disparity_of_the_frames(sample: Any) -> None:
    disparity_px = 10 / WALL_M
    np.testing.assert_allclose(sample.true_px, disparity_px, rtol=1e-6)  # The sky is as far as the wall.
    measured = sample.measured_px > 0
    np.testing.assert_allclose(sample.measured_px[measured], disparity_px, rtol=1e-6)
    assert not measured[:, 22:38, 32:58].any() and measured[:, :15].all()
    assert sample.is_sky[:, :4].all() and not sample.is_sky[:, 4:].any()
    moved = sample.landing[1:, 20:-20, 20:-20, 0] - np.arange(20, SHAPE[1] - 20)
    assert np.median(moved) == 1  # What a frame shows was one pixel farther right in the frame before.


def test_a_part_that_is_larger_than_its_sample_is_padded_with_what_is_unknown(sample: Any) -> None:
    height_px, width_px = SHAPE
    part = sample.cropped(np.random.default_rng(1), 4, height_px + 32, width_px + 64)
    assert part.gray.shape == (4, height_px + 32, width_px + 64)
    for image in (part.measured_px, part.true_px, part.is_sky):
        assert not image[:, height_px:].any() and not image[:, :, width_px:].any()


@pytest.mark.slow
@pytest.mark.testbed
def test_every_training_world_can_be_built() -> None:
    clips = import_module("learned_plugin.clips")
    assert all(clips.sequence(world, clips.FIRST_SEED).sequence.name == world for world in clips.WORLDS)


@needs_runtime
def test_the_trained_network_corrects_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("learned_plugin.WEIGHTS", tmp_path)
    with pytest.raises(ConfigError, match=r"there is no network in .*: run python -m learned_plugin\.train"):
        create_corrector("retrained", camera(SHAPE))
    for suffix in ("onnx", "toml"):
        shutil.copy(FOLDER / f"corrector.{suffix}", tmp_path)
    retrained, shipped = create_corrector("retrained", camera(SHAPE)), create_bare("learned", camera(SHAPE))
    for index in range(2):
        images = frame(scene(index, SHAPE), texture(0, SHAPE), index=index)
        one, other = retrained.process(images), shipped.process(images)
        assert one.depth_m.tobytes() == other.depth_m.tobytes()
        assert one.confidence.tobytes() == other.confidence.tobytes()
    assert latency_s("retrained") == latency_s("learned")


@needs_runtime
@pytest.mark.testbed
def test_only_a_whole_network_of_the_same_inputs_is_not_trained_again(tmp_path: Path) -> None:
    train = import_module("learned_plugin.train")
    inputs = train.digest_of_inputs(0, 3, 3000)
    shutil.copy(FOLDER / "corrector.onnx", tmp_path)
    card = (FOLDER / "corrector.toml").read_text()
    (tmp_path / "corrector.toml").write_text(f'inputs = "{inputs}"\n{card}')
    train.train(seed=0, flights=3, steps=3000, out=tmp_path)  # It makes no clip, and needs no PyTorch.
    assert {file.name for file in tmp_path.iterdir()} == {"corrector.onnx", "corrector.toml"}
    for others in ((1, 3, 3000), (0, 2, 3000), (0, 3, 2999)):
        assert not train.is_finished(tmp_path, train.digest_of_inputs(*others))
    damaged = tmp_path / "damaged"
    damaged.mkdir()
    shutil.copy(tmp_path / "corrector.toml", damaged)
    (damaged / "corrector.onnx").write_bytes(b"")
    assert not train.is_finished(damaged, inputs)


@pytest.mark.slow
def test_two_steps_give_the_same_network_twice(sample: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("torch")
    pytest.importorskip("onnx")
    train = import_module("learned_plugin.train")
    monkeypatch.setattr(train, "samples", lambda folder, flights: [sample])
    for name in ("first", "second"):
        train.train(seed=5, flights=1, steps=2, out=tmp_path / name)
        assert train.is_finished(tmp_path / name, train.digest_of_inputs(5, 1, 2))
    first, second = ((tmp_path / name / "corrector.onnx").read_bytes() for name in ("first", "second"))
    assert first == second
