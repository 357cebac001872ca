"""The command line and the library offer the same choices under the same names."""

from typing import get_args

from scenarios.commands.correct import Format
from scenarios.commands.options import DEFAULT_CORRECTOR, Depth, RendererName
from scenarios.commands.swarm import Prior
from sim.render import RENDERER_NAMES
from sim.tiers import TIER_NAMES
from swarm.priors import PosePriorName
from voxdepth.datasets import DATASET_FORMATS
from voxdepth.registry import DEFAULT


def test_the_command_line_speaks_the_words_of_the_library() -> None:
    assert tuple(Format) == ("auto", *DATASET_FORMATS)
    assert tuple(Depth) == TIER_NAMES
    assert tuple(RendererName) == RENDERER_NAMES
    assert tuple(Prior) == get_args(PosePriorName)
    assert DEFAULT_CORRECTOR == DEFAULT
