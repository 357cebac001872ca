"""The networks of the library: ONNX files with their cards, and ONNX Runtime, which the extra `learned` installs.

A card is a TOML file beside the network. It states the digest, and how the network was made.
"""

import hashlib
import tomllib
from collections.abc import Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import ConfigError

FOLDER = Path(__file__).parent
EXTRA = "learned"
ImageBatch = npt.NDArray[np.float32]


class Network:
    """A network that ONNX Runtime runs on one thread, so that the same images give the same bytes.

    Several threads may run it at once.

    Args:
        content: The ONNX file.
    """

    def __init__(self, content: bytes) -> None:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.use_deterministic_compute = True
        options.log_severity_level = 4
        self._session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        self._input = self._session.get_inputs()[0].name

    def run(self, images: ImageBatch) -> Sequence[ImageBatch]:
        """Return the outputs for images of shape (1, C, h, w)."""
        outputs: Sequence[Any] = self._session.run(None, {self._input: images})
        return outputs


def has_runtime() -> bool:
    """Return whether ONNX Runtime is installed. It is not imported."""
    return find_spec("onnxruntime") is not None


@cache
def load(name: str, folder: Path = FOLDER) -> Network:
    """Return a network of the library, which all of its users share.

    Raises:
        ConfigError: ONNX Runtime is not installed; or the card or the network is missing or damaged.
    """
    if not has_runtime():
        raise ConfigError(f"the network {name!r} needs ONNX Runtime: pip install 'voxdepth[{EXTRA}]'")
    file, card = folder / f"{name}.onnx", read_card(folder / f"{name}.toml")
    try:
        content = file.read_bytes()
    except OSError as error:
        raise ConfigError(f"cannot read the network {file}: {error.strerror}; {_RESTORE}") from error
    digest = hashlib.sha256(content).hexdigest()
    if digest != card["sha256"]:
        raise ConfigError(
            f"{file} is damaged or of another version: expected the SHA-256 {card['sha256'][:12]}..., got "
            f"{digest[:12]}...; {_RESTORE}"
        )
    return Network(content)


def read_card(file: Path) -> dict[str, Any]:
    """Return what is known of a network, of which the library needs `sha256`; else it is a `ConfigError`."""
    try:
        card = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigError(f"cannot read the card {file}: {str(error).splitlines()[0]}; {_RESTORE}") from error
    if not isinstance(card.get("sha256"), str):
        raise ConfigError(f"the card {file} is damaged: expected the key sha256; {_RESTORE}")
    return card


_RESTORE = f"restore it with pip install --force-reinstall 'voxdepth[{EXTRA}]'"
