"""A small context for experiments: the beginning of sim-MB in tiny images, recorded once for all tests of a module."""

from pathlib import Path

from scenarios.experiments.experiment import ExperimentContext

SEQUENCE, WIDTH_PX = "sim-MB", 160


def small_context(out: Path, frames: int) -> ExperimentContext:
    """Images of 160x90."""
    return ExperimentContext(
        out=out, sequences=(SEQUENCE,), frames=frames, width_px=WIDTH_PX, seed=0, report=lambda what: None
    )
