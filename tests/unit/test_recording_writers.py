"""Writers that get in each other's way, or that never got started."""

import errno
import os
from pathlib import Path

import pytest

from sim.errors import RecordingError
from sim.recording import files
from tests.unit.test_recording_format import FRAMES, N, contents, create, finish, reads_back, resume


def test_two_writers_do_not_share_a_folder(tmp_path: Path) -> None:
    first = create(tmp_path / "r")
    first.append(*FRAMES[0])
    before = contents(tmp_path / "r")
    with pytest.raises(RecordingError, match="another writer is recording"):
        resume(tmp_path / "r")
    assert contents(tmp_path / "r") == before
    first.close()
    with resume(tmp_path / "r") as second:
        assert second.frames == 1
        finish(second)
    assert reads_back(tmp_path / "r", N)


@pytest.mark.parametrize("n_writes", range(4))
def test_a_disk_that_is_full_from_the_start_can_be_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, n_writes: int
) -> None:
    real, calls = files.write, iter(range(100))

    def full_after(path: Path, data: bytes, mode: str) -> None:
        if next(calls) >= n_writes:
            real(path, data[: len(data) // 2], mode)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(path, data, mode)

    with monkeypatch.context() as patched:
        patched.setattr(files, "write", full_after)
        with pytest.raises(RecordingError, match="No space left on device"):
            create(tmp_path / "r")
    with create(tmp_path / "r") as writer:
        finish(writer)
    assert reads_back(tmp_path / "r", N)
