"""The network of the library: its files are checked, and the same images give the same bytes."""

import hashlib
import shutil
from pathlib import Path

import numpy as np
import pytest

from voxdepth import networks
from voxdepth.errors import ConfigError
from voxdepth.networks import FOLDER, load, read_card

NAME, CHANNELS = "corrector", 10
FILE, CARD = FOLDER / f"{NAME}.onnx", FOLDER / f"{NAME}.toml"
needs_runtime = pytest.mark.skipif(not networks.has_runtime(), reason="needs the extra learned")


def test_the_shipped_network_is_small_and_its_card_tells_how_it_was_made() -> None:
    content, card = FILE.read_bytes(), read_card(CARD)
    assert len(content) == card["bytes"] <= 500_000
    assert hashlib.sha256(content).hexdigest() == card["sha256"]
    assert card["parameters"] <= 500_000
    assert card["largest_difference_to_pytorch"] <= 1e-4
    assert card["command"].startswith(f"voxdepth train {NAME} ")
    assert {"commit", "seed", "steps", "worlds", "world_seeds", "final_loss", "licence", "versions"} <= set(card)


@needs_runtime
@pytest.mark.parametrize("shape", [(32, 32), (96, 160)])
def test_the_same_images_give_the_same_bytes_at_any_size(shape: tuple[int, int]) -> None:
    images = np.random.default_rng(shape[0]).random((1, CHANNELS, *shape), np.float32)
    first, again = load(NAME).run(images), networks.Network(FILE.read_bytes()).run(images)
    for one, other in zip(first, again, strict=True):
        assert one.shape == (1, 1, *shape) and np.isfinite(one).all()
        assert one.tobytes() == other.tobytes()


def flipped(content: bytes) -> bytes:
    """The same with another bit in the middle."""
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


@needs_runtime
@pytest.mark.parametrize(
    ("suffix", "content", "message"),
    [
        ("onnx", flipped(FILE.read_bytes()), r"\.onnx is damaged or of another version: expected .*restore it"),
        ("onnx", None, r"cannot read .*\.onnx: .*restore it with pip install"),
        ("toml", None, r"cannot read .*\.toml: .*restore it with pip install"),
        ("toml", b"format = [", r"\.toml.*restore it with pip install"),
        ("toml", b"format = 1", r"\.toml.*restore it with pip install"),
        ("toml", b"format = 1\nsha256 = 2", r"\.toml.*restore it with pip install"),
    ],
    ids=["damaged", "missing", "no card", "no TOML", "no digest", "digest of another type"],
)
def test_a_network_that_is_not_whole_is_refused(
    suffix: str, content: bytes | None, message: str, tmp_path: Path
) -> None:
    shutil.copy(FILE, tmp_path)
    shutil.copy(CARD, tmp_path)
    file = tmp_path / f"{NAME}.{suffix}"
    file.unlink() if content is None else file.write_bytes(content)
    with pytest.raises(ConfigError, match=message) as reported:
        load(NAME, tmp_path)
    assert "\n" not in str(reported.value)


def test_without_the_extra_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(networks, "has_runtime", lambda: False)
    load.cache_clear()
    with pytest.raises(ConfigError, match=r"^the network '\w+' needs ONNX Runtime: pip install 'voxdepth"):
        load(NAME)
