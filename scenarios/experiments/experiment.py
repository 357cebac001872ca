"""What all experiments have in common."""

from typing import Protocol

from .result import Result
from .stage import Scope, Stage


class Experiment(Protocol):
    """A question of the paper that can be asked again."""

    @property
    def name(self) -> str:
        """By which it is called, and its folder."""
        ...

    @property
    def question(self) -> str:
        """The paper's question in one sentence."""
        ...

    @property
    def scope(self) -> Scope:
        """What it works on unless the user says otherwise."""
        ...

    def run(self, stage: Stage) -> Result:
        """Ask it.

        Raises:
            ScenarioError, SimError, VoxDepthError: A sequence cannot be had, or a method failed.
        """
        ...
