"""The files of another revision of a checkout, in a temporary folder; nothing of them stays."""

import io
import subprocess
import tarfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from .errors import ScenarioError


def git(folder: Path, *arguments: str) -> "subprocess.CompletedProcess[bytes]":
    """Run git in a folder; a system without it is a `ScenarioError`."""
    try:
        return subprocess.run(["git", "-C", str(folder), *arguments], capture_output=True, check=False)
    except OSError as error:
        raise ScenarioError(f"cannot run git ({error}): install it to compare with a revision") from error


def top_of(folder: Path) -> Path:
    """Return the top folder of the checkout that a folder lies in; a `ScenarioError` outside of one."""
    found = git(folder, "rev-parse", "--show-toplevel")
    if found.returncode:
        raise ScenarioError(f"{folder} is in no git checkout: stand in the one whose revision is meant")
    return Path(found.stdout.decode().removesuffix("\n")).resolve()


def commit_of(folder: Path, rev: str) -> str:
    """Return the hash of a commit of the checkout around a folder; a `ScenarioError` if there is none of that name."""
    found = git(top_of(folder), "rev-parse", "--verify", "--quiet", "--end-of-options", f"{rev}^{{commit}}")
    if found.returncode:
        raise ScenarioError(f"there is no commit {rev!r}: expected one that git log shows, or fetch it first")
    return found.stdout.decode().strip()


@contextmanager
def checkout(folder: Path, rev: str) -> Iterator[Path]:
    """Give the files of a commit of the checkout around a folder, for as long as they are needed.

    Raises:
        ScenarioError: The folder is in no checkout, or there is no such commit.
    """
    archive = git(top_of(folder), "archive", "--format=tar", commit_of(folder, rev))
    if archive.returncode:
        raise ScenarioError(f"cannot read commit {rev}: {archive.stderr.decode().strip().splitlines()[-1]}")
    with TemporaryDirectory() as name:
        tree = Path(name).resolve() / "tree"
        with tarfile.open(fileobj=io.BytesIO(archive.stdout)) as files:
            files.extractall(tree, filter="data")
        yield tree
