"""The corrector `learned` with a network that you trained: `retrained`."""

from pathlib import Path

from voxdepth import Intrinsics
from voxdepth.baselines.learned import Learned
from voxdepth.errors import ConfigError
from voxdepth.networks import load
from voxdepth.registry import latency_s

NAME, WEIGHTS = "corrector", Path(__file__).parent / "weights"
"""The network, and the folder of its ONNX file and its card."""


class Retrained(Learned):
    """Corrects by the network in `WEIGHTS`. Its confidence is that of the network, which is not fitted.

    Raises:
        ConfigError: No network was trained; see also `Learned`.
    """

    latency_s = latency_s("learned")

    def __init__(self, intrinsics: Intrinsics) -> None:
        if not (WEIGHTS / f"{NAME}.toml").exists():
            raise ConfigError(f"there is no network in {WEIGHTS}: run python -m learned_plugin.train")
        super().__init__(intrinsics, load(NAME, WEIGHTS))
