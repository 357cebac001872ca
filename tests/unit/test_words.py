"""The command line and the library offer the same choices under the same names."""

from typing import get_args

from scenarios.commands.options import Depth, RendererName
from scenarios.commands.swarm import Prior
from scenarios.config import Scenario, load_run
from sim.depth_noise import SENSOR_MODEL_NAMES
from sim.render import RENDERER_NAMES
from swarm.odometry import PosePriorName
from voxdepth.registry import DEFAULT, config_of
from voxdepth.temporal.config import TemporalConfig
from voxdepth.tools.options import DEFAULT_CORRECTOR


def test_the_command_line_speaks_the_words_of_the_library() -> None:
    assert tuple(Depth) == SENSOR_MODEL_NAMES
    assert tuple(RendererName) == RENDERER_NAMES
    assert tuple(Prior) == get_args(PosePriorName)


def test_the_default_corrector_is_the_same_everywhere() -> None:
    assert DEFAULT_CORRECTOR == DEFAULT == load_run("city", None, {}).scenario.corrector.name
    assert Scenario.model_fields["corrector"].default.name == DEFAULT
    assert type(config_of(DEFAULT)) is TemporalConfig
