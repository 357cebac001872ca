"""All experiments by name."""

from collections.abc import Sequence

from ..errors import ScenarioError
from .ablation import Ablation
from .components import Components
from .default import Default
from .experiment import Experiment
from .filling import Filling
from .frame_rate import FrameRate
from .frame_size import FrameSize
from .holes import Holes
from .optical_flow import OpticalFlow
from .power import Power
from .quality import Quality
from .switches import Switches
from .window import Window

ALL = "all"
_OF_PAPER: tuple[Experiment, ...] = (
    Holes(),
    FrameSize(),
    Filling(),
    OpticalFlow(),
    Quality(),
    FrameRate(),
    Components(),
    Power(),
    Window(),
    Switches(),
)
_OF_DEFAULT: tuple[Experiment, ...] = (Default(), Ablation())
"""Questions about the default method, which the paper does not have."""
_EXPERIMENTS = (*_OF_PAPER, *_OF_DEFAULT)
PAPER_NAMES = tuple(experiment.name for experiment in _OF_PAPER)
"""In the paper's order."""
EXPERIMENT_NAMES = tuple(experiment.name for experiment in _EXPERIMENTS)


def find_experiments(names: Sequence[str]) -> list[Experiment]:
    """Experiments by name, in the order of the names; `all` stands for every one of the paper's.

    Raises:
        ScenarioError: There is none of that name, or one is named twice.
    """
    by_name = {experiment.name: experiment for experiment in _EXPERIMENTS}
    wanted = [found for name in names for found in (PAPER_NAMES if name == ALL else (name,))]
    for name in wanted:
        if name not in by_name:
            known = ", ".join((*EXPERIMENT_NAMES, ALL))
            raise ScenarioError(f"there is no experiment {name!r}; choose one or more of: {known}")
        if wanted.count(name) > 1:
            raise ScenarioError(f"the experiment {name!r} is named twice: once is enough")
    return [by_name[name] for name in wanted]
