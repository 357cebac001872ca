"""The networks of the library: their files are checked, and the same images give the same bytes."""

import hashlib
import shutil
from pathlib import Path

import numpy as np
import pytest

from voxdepth import networks
from voxdepth.errors import ConfigError
from voxdepth.networks import FOLDER, load, read_card

NAMES = ("corrector",)
CHANNELS = {"corrector": 10}
LARGEST_BYTES = 500_000

needs_runtime = pytest.mark.skipif(not networks.has_runtime(), reason="needs the extra learned")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the networks, which a test may damage."""
    return Path(shutil.copytree(FOLDER, tmp_path / "networks", ignore=shutil.ignore_patterns("__pycache__")))


@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_network_is_small_and_its_card_tells_how_it_was_made(name: str) -> None:
    content, card = (FOLDER / f"{name}.onnx").read_bytes(), read_card(FOLDER / f"{name}.toml")
    assert len(content) == card["bytes"] <= LARGEST_BYTES
    assert hashlib.sha256(content).hexdigest() == card["sha256"]
    assert card["parameters"] <= 500_000
    assert card["largest_difference_to_pytorch"] <= 1e-4
    assert card["command"].startswith(f"voxdepth train {name} ")
    assert {"commit", "seed", "steps", "worlds", "world_seeds", "final_loss", "licence", "versions"} <= set(card)


@needs_runtime
@pytest.mark.parametrize("name", NAMES)
def test_the_same_images_give_the_same_bytes_at_any_size(name: str) -> None:
    for height, width in ((32, 32), (96, 160)):
        images = np.random.default_rng(height).random((1, CHANNELS[name], height, width), np.float32)
        first, again = load(name).run(images), networks.Network((FOLDER / f"{name}.onnx").read_bytes()).run(images)
        for one, other in zip(first, again, strict=True):
            assert one.shape == (1, 1, height, width) and np.isfinite(one).all()
            assert one.tobytes() == other.tobytes()


@needs_runtime
@pytest.mark.parametrize("name", NAMES)
class TestBadFiles:
    def test_a_damaged_network_is_refused(self, name: str, folder: Path) -> None:
        file = folder / f"{name}.onnx"
        content = bytearray(file.read_bytes())
        content[len(content) // 2] ^= 1
        file.write_bytes(content)
        with pytest.raises(ConfigError, match=rf"{name}\.onnx is damaged or of another version: expected .*restore it"):
            load(name, folder)

    def test_a_network_of_another_version_is_refused(self, name: str, folder: Path) -> None:
        card = folder / f"{name}.toml"
        card.write_text(card.read_text().replace("format = 1\n", "format = 2\n"))
        with pytest.raises(ConfigError, match=r"of format 2, and this version of voxdepth reads format 1: install"):
            load(name, folder)

    @pytest.mark.parametrize("suffix", ["onnx", "toml"])
    def test_a_missing_file_is_refused(self, name: str, suffix: str, folder: Path) -> None:
        (folder / f"{name}.{suffix}").unlink()
        with pytest.raises(ConfigError, match=rf"cannot read .*{name}\.{suffix}: .*restore it with pip install"):
            load(name, folder)

    @pytest.mark.parametrize("text", ["format = [", "format = 1", "format = 1\nsha256 = 2"])
    def test_a_damaged_card_is_refused(self, name: str, text: str, folder: Path) -> None:
        (folder / f"{name}.toml").write_text(text)
        with pytest.raises(ConfigError, match=rf"{name}\.toml.*restore it with pip install") as told:
            load(name, folder)
        assert "\n" not in str(told.value)


def test_without_the_extra_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(networks, "has_runtime", lambda: False)
    load.cache_clear()
    for name in NAMES:
        with pytest.raises(ConfigError, match=r"^the network '\w+' needs ONNX Runtime: pip install 'voxdepth"):
            load(name)
