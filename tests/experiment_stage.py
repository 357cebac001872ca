"""A small stage for experiments: the beginning of sim-MB in tiny images, recorded once for all tests of a module."""

from pathlib import Path

from scenarios.experiments.stage import Stage

SEQUENCE, WIDTH_PX = "sim-MB", 160


def small_stage(out: Path, frames: int) -> Stage:
    """Images of 160x90."""
    return Stage(out=out, sequences=(SEQUENCE,), frames=frames, width_px=WIDTH_PX, seed=None, tell=lambda what: None)
