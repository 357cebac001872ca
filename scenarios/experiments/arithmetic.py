"""The percentages of the paper's text, worked out again from its own tables."""

from collections.abc import Sequence
from statistics import mean

from ..evaluation.paper import M_RMSE, METHODS, PSNR_DB
from .paper import COMPONENTS_MS, FRAMES_PER_S, SWITCHES
from .result import Column, Table, Value

REAL = ("LN", "MB")
SYNTHETIC = ("KTS", "KTC", "PLF", "PLW")
VD = METHODS.index("VD")
SATURATION = 175.0
"""Wrapped errors above this are all but those of unrelated images, which score 179.96."""


def by_text() -> Table:
    """Every percentage that the tables can tell, beside what the text says."""
    columns = (Column(name="claim"), Column(name="printed", unit="%"), Column(name="by its tables", unit="%"),
               Column(name="how"))  # fmt: skip
    rows = [*_of_quality(), *_of_speed()]
    return Table.of("The paper's percentages by its own tables", columns, rows, "arithmetic")


def _of_quality() -> list[Sequence[Value]]:
    gains = {name: gain(values) for name, values in PSNR_DB.items()}
    ahead, behind = ("LN", "KTS", "KTC", "PLF"), ("MB", "PLW")
    reductions = [100 * (1 - M_RMSE[name][VD] / min(_others(M_RMSE[name]))) for name in ahead]
    lags = [100 * (M_RMSE[name][VD] / min(_others(M_RMSE[name])) - 1) for name in behind]
    return [
        ("PSNR over the best other, LN", 31.0, gains["LN"], "VD / best other - 1"),
        ("PSNR over the best other, MB", 31.0, gains["MB"], "VD / best other - 1"),
        ("PSNR over the best other, LN and MB", 31.0, mean(gains[name] for name in REAL), "mean of the two"),
        ("PSNR over RealSense, LN and MB", 31.0, mean(over(name, "RS") for name in REAL), "mean of VD / RS - 1"),
        (
            "PSNR over the best other, KTC, PLF, PLW",
            14.07,
            mean(gains[name] for name in SYNTHETIC[1:]),
            "mean of three",
        ),
        ("masked RMSE, LN, KTS, KTC, PLF", 25.23, mean(_lead(name) for name in ahead), "mean of best other / VD - 1"),
        ("masked RMSE, the same as a reduction", 25.23, mean(reductions), "mean of 1 - VD / best other"),
        ("masked RMSE, MB and PLW", 2.08, mean(lags), "mean of VD / best other - 1"),
    ]


def _of_speed() -> list[Sequence[Value]]:
    real = mean(SWITCHES[name] for name in REAL)
    without_kts, all_four = (mean(SWITCHES[name] for name in names) for names in (SYNTHETIC[1:], SYNTHETIC))
    fps = FRAMES_PER_S
    return [
        ("fewer switches, synthetic without KTS", 40.33, 100 * (1 - without_kts / real), "1 - mean / mean of LN, MB"),
        ("fewer switches, all synthetic", 40.33, 100 * (1 - all_four / real), "1 - mean / mean of LN, MB"),
        ("pipelined over not pipelined", 21.0, 100 * (fps["VD"] / fps["VD-Nopipe"] - 1), "VD / VD-Nopipe - 1"),
        ("frame rate over the closest other method", 58.0, 100 * (fps["VD"] / fps["GS"] - 1), "VD / GS - 1"),
        ("frame rate over prior work, at least", 70.0, 100 * (fps["VD"] / fps["GS"] - 1), "VD / GS - 1"),
        ("fusion over inpainting, Jetson", 290.0, 100 * COMPONENTS_MS["fusion"][0] / COMPONENTS_MS["inpainting"][0],
         "fusion / inpainting"),
    ]  # fmt: skip


def gain(values: Sequence[float]) -> float:
    """How much higher VoxDepth's value is than the highest of the others [%]."""
    return 100 * (values[VD] / max(_others(values)) - 1)


def over(name: str, method: str) -> float:
    """How much higher VoxDepth's PSNR of a dataset is than that of another method [%]."""
    return 100 * (PSNR_DB[name][VD] / PSNR_DB[name][METHODS.index(method)] - 1)


def saturated() -> tuple[int, int]:
    """How many of the printed masked errors lie above `SATURATION`, and how many there are."""
    values = [value for row in M_RMSE.values() for value in row]
    return sum(value > SATURATION for value in values), len(values)


def _lead(name: str) -> float:
    """Lowest masked error of the other methods over VoxDepth's, less one [%]; negative where VoxDepth is behind."""
    return 100 * (min(_others(M_RMSE[name])) / M_RMSE[name][VD] - 1)


def _others(values: Sequence[float]) -> Sequence[float]:
    return [value for place, value in enumerate(values) if place != VD]
