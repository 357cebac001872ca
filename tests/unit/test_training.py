"""Training data are what the truth says, and a training gives the same bytes again."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenarios.training import MOST_FLIGHTS
from scenarios.training.clips import FIRST_SEED, HELD_OUT_SEED, WORLDS, Clip, places
from scenarios.training.samples import cropped, sample_of
from voxdepth.networks import load

HEIGHT_PX, WIDTH_PX, FRAMES = 96, 128, 10
FOCAL_PX, BASELINE_M = 100.0, 0.1
WALL_M = 4.0


@pytest.fixture
def clip() -> Clip:
    """A camera that moves along a textured wall by a pixel a frame, with a hole in its depth."""
    wall = np.random.default_rng(0).integers(0, 255, (HEIGHT_PX, WIDTH_PX + FRAMES)).astype(np.uint8)
    true_m = np.full((FRAMES, HEIGHT_PX, WIDTH_PX), WALL_M, np.float32)
    raw_m = true_m.copy()
    raw_m[:, 20:40, 30:60] = 0
    camera = (FOCAL_PX, FOCAL_PX, WIDTH_PX / 2, HEIGHT_PX / 2, BASELINE_M, 1.0)
    gray = np.stack([wall[:, k : k + WIDTH_PX] for k in range(FRAMES)])
    return Clip(gray=gray, raw_m=raw_m, true_m=true_m, camera=np.array(camera))


@pytest.mark.slow
def test_no_held_out_clip_is_learned_from() -> None:
    learned = {place.file(Path()) for place in places(range(FIRST_SEED, FIRST_SEED + MOST_FLIGHTS))}
    held_out = places([HELD_OUT_SEED])
    assert {place.world for place in held_out} == set(WORLDS)
    assert learned.isdisjoint(place.file(Path()) for place in held_out)


def test_a_sample_is_the_disparity_of_the_clip(clip: Clip) -> None:
    sample = sample_of(clip)
    disparity_px = FOCAL_PX * BASELINE_M / WALL_M
    np.testing.assert_allclose(sample.true_px, disparity_px, rtol=1e-6)
    measured = sample.measured_px > 0
    np.testing.assert_allclose(sample.measured_px[measured], disparity_px, rtol=1e-6)
    assert not measured[:, 22:38, 32:58].any() and measured[:, :15].all()
    assert not sample.is_sky.any()
    cols = np.arange(WIDTH_PX)
    moved = sample.landing[1:, 20:-20, 20:-20, 0] - cols[20:-20]
    assert np.median(moved) == 1  # What a frame shows was one pixel farther right in the frame before.


def test_a_part_that_is_larger_than_its_sample_is_padded_with_what_is_unknown(clip: Clip) -> None:
    part = cropped(sample_of(clip), np.random.default_rng(1), 4, HEIGHT_PX + 32, WIDTH_PX + 64)
    assert part.gray.shape == (4, HEIGHT_PX + 32, WIDTH_PX + 64)
    for image in (part.measured_px, part.true_px):
        assert not image[:, HEIGHT_PX:].any() and not image[:, :, WIDTH_PX:].any()


class TestWithPyTorch:
    """Skipped without the extra `train`."""

    @pytest.fixture(autouse=True)
    def _torch(self) -> None:
        pytest.importorskip("torch")
        pytest.importorskip("onnx")

    @pytest.mark.parametrize("name", ["corrector", "convex"])
    def test_a_training_is_repeated_to_the_byte(self, name: Any, clip: Clip, tmp_path: Path) -> None:
        import torch

        from scenarios.training.export import write_network
        from scenarios.training.optimisation import Run
        from scenarios.training.run import TASKS

        torch.set_num_threads(1)
        task, contents = TASKS[name], []
        for _ in range(2):
            network, losses = task.train([task.prepare(clip)], Run(5, steps=2), lambda text: None)
            content, facts = write_network(tmp_path, name, network, task.channels)
            contents.append(content)
            assert len(losses) == 2 and np.isfinite(losses).all()
            assert facts["largest_difference_to_pytorch"] <= 1e-4 and facts["parameters"] <= 500_000
        assert contents[0] == contents[1]

    def test_a_finished_training_is_not_repeated(self, clip: Clip, tmp_path: Path, monkeypatch: Any) -> None:
        from scenarios.training import run

        monkeypatch.setattr(run, "_clips", lambda out, seeds, report: [clip])
        training = run.Training(name="convex", seed=3, flights=1, steps=1)
        card = run.train(training, tmp_path, lambda text: None)
        monkeypatch.delattr(run, "_clips")
        assert run.train(training, tmp_path, lambda text: None) == card
        load("convex", tmp_path / "seed-3")
        assert card["command"] == "voxdepth train convex --seed 3 --flights 1 --steps 1"
        assert (tmp_path / "seed-3" / "convex.png").stat().st_size > 0
