"""What is finished of one sequence: its cells and its facts, as far as they still hold."""

from pathlib import Path

import pydantic

from .cell import Cell, Key, cell_path, read_cell, write_model
from .facts import Facts, facts_path, read_facts

NOT_DONE = "not done yet"
OTHER_FILE = "its file is of another version or damaged"
FOREIGN = "its code is not ours and may have changed"


class Shelf:
    """Where the results of one sequence lie, below the folder of all results."""

    def __init__(self, out: Path, sequence: str) -> None:
        self._out, self._sequence = out, sequence

    def cell(self, key: Key, *, may_have_changed: bool) -> Cell:
        """The finished cell of a key; or one with the error `NOT_DONE`, and why an older one does not hold.

        Args:
            key: Of what is wanted now.
            may_have_changed: Whether the method may be another one although its key is the same.

        Raises:
            ScenarioError: The file of the cell cannot be read.
        """
        try:
            cell = read_cell(self._path(key.method))
        except pydantic.ValidationError:
            return Cell(key=key, error=NOT_DONE, replaced=OTHER_FILE)
        if cell is None:
            return Cell(key=key, error=NOT_DONE)
        difference = key.difference(cell.key) or (FOREIGN if may_have_changed else "")
        if difference:
            return Cell(key=key, error=NOT_DONE, replaced=difference)
        return cell.model_copy(update={"replaced": None})

    def put(self, cell: Cell) -> None:
        """Store a cell in one step.

        Raises:
            ScenarioError: It cannot be written.
        """
        write_model(self._path(cell.key.method), cell)

    def facts(self, digest: str, frames: int) -> Facts | None:
        """The facts of the sequence; None if there are none of these frames."""
        facts = read_facts(facts_path(self._out, self._sequence))
        return facts if facts is not None and (facts.digest, facts.frames) == (digest, frames) else None

    def put_facts(self, facts: Facts) -> None:
        """Store the facts in one step.

        Raises:
            ScenarioError: They cannot be written.
        """
        write_model(facts_path(self._out, self._sequence), facts)

    def _path(self, method: str) -> Path:
        return cell_path(self._out, self._sequence, method)
