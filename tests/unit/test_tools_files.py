"""Files that appear as a whole."""

from pathlib import Path

import pytest

from voxdepth.tools.errors import ToolError
from voxdepth.tools.files import atomic


def test_a_folder_that_another_process_filled_meanwhile_stays_and_is_named(tmp_path: Path) -> None:
    out = tmp_path / "out"
    message = rf"^{out} has files by now, which nothing replaces: name another folder$"
    with pytest.raises(ToolError, match=message), atomic(out) as folder:
        folder.mkdir()
        (folder / "mine").touch()
        out.mkdir()
        (out / "theirs").touch()
    assert [path.name for path in tmp_path.rglob("*")] == ["out", "theirs"]


def test_a_folder_that_another_process_made_meanwhile_is_replaced_while_it_is_empty(tmp_path: Path) -> None:
    with atomic(tmp_path / "out") as folder:
        folder.mkdir()
        (folder / "mine").touch()
        (tmp_path / "out").mkdir()
    assert [path.name for path in tmp_path.rglob("*")] == ["out", "mine"]
