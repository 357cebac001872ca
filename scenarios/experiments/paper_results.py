"""Numbers that the paper prints, which were measured on other data, and the percentages of its text by its tables."""

from statistics import mean

import pandas as pd

METHODS = ("VD", "RS", "GS", "DS")
"""VoxDepth, RealSense, GSmooth, DeepSmooth."""
SEQUENCES = {f"sim-{name}": name for name in ("LN", "MB", "KTS", "KTC", "PLF", "PLW")}
"""The paper's name of the dataset that a shipped sequence stands for, in the paper's order."""
PSNR_DB = pd.DataFrame.from_dict({
    "LN": (17.46, 13.04, 13.14, 14.16),
    "MB": (17.10, 13.17, 15.36, 10.51),
    "KTS": (17.69, 14.60, 18.59, 22.87),
    "KTC": (20.32, 17.66, 18.59, 14.89),
    "PLF": (15.81, 13.55, 12.97, 13.62),
    "PLW": (16.05, 13.73, 13.14, 13.37),
}, orient="index", columns=METHODS)  # fmt: skip
M_RMSE = pd.DataFrame.from_dict({
    "LN": (112.25, 167.25, 179.08, 180.03),
    "MB": (177.61, 175.61, 176.75, 178.04),
    "KTS": (102.23, 139.69, 172.02, 175.68),
    "KTC": (126.15, 144.70, 177.93, 178.89),
    "PLF": (157.95, 159.15, 178.70, 178.38),
    "PLW": (169.79, 164.79, 177.59, 178.87),
}, orient="index", columns=METHODS)  # fmt: skip
"""Printed without a unit; see `voxdepth.metrics.m_rmse_u16_wrap` for why so many lie just below 180."""
SWARM = "Swarm"
"""The paper's name of the drones with onboard perception of Kabore and Gueler."""
FRAMES_PER_S = {"VD": 26.71, "VD-Nopipe": 21.91, "RS": 39.52, "GS": 16.89, "DS": 2.0, SWARM: 14.0}
COMPONENTS_MS = {"fusion": 280, "inpainting": 94}
"""Mean time on the Jetson Nano."""
SWITCHES = {"LN": 10, "MB": 10, "KTS": 4, "KTC": 14, "PLF": 4, "PLW": 5}
"""State switches in 500 frames."""

REAL = ("LN", "MB")
SYNTHETIC = ("KTS", "KTC", "PLF", "PLW")
AHEAD, BEHIND = ("LN", "KTS", "KTC", "PLF"), ("MB", "PLW")
"""Datasets on which VoxDepth has the lowest masked error of all methods, and the others."""
SATURATION = 175.0
"""Wrapped errors above this are nearly those of unrelated images, which score 179.96."""


def percentages_table() -> pd.DataFrame:
    """Every percentage of the text that follows from the tables, as printed and as computed."""
    gains = 100 * (PSNR_DB["VD"] / PSNR_DB.drop(columns="VD").max(axis="columns") - 1)
    over_rs = 100 * (PSNR_DB["VD"] / PSNR_DB["RS"] - 1)
    ratios = M_RMSE["VD"] / M_RMSE.drop(columns="VD").min(axis="columns")
    ahead, behind = ratios[list(AHEAD)], ratios[list(BEHIND)]
    real_switches = mean(SWITCHES[name] for name in REAL)
    without_kts, all_four = (mean(SWITCHES[name] for name in names) for names in (SYNTHETIC[1:], SYNTHETIC))
    fps, over_gs = FRAMES_PER_S, 100 * (FRAMES_PER_S["VD"] / FRAMES_PER_S["GS"] - 1)
    rows = [
        ("PSNR over the best other, LN", 31.0, float(gains["LN"]), "VD / best other - 1"),
        ("PSNR over the best other, MB", 31.0, float(gains["MB"]), "VD / best other - 1"),
        ("PSNR over the best other, LN and MB", 31.0, mean(gains[list(REAL)]), "mean of the two"),
        ("PSNR over RealSense, LN and MB", 31.0, mean(over_rs[list(REAL)]), "mean of VD / RS - 1"),
        ("PSNR over the best other, KTC, PLF, PLW", 14.07, mean(gains[list(SYNTHETIC[1:])]), "mean of three"),
        ("masked RMSE, LN, KTS, KTC, PLF", 25.23, mean(100 * (1 / ahead - 1)), "mean of best other / VD - 1"),
        ("masked RMSE, the same as a reduction", 25.23, mean(100 * (1 - ahead)), "mean of 1 - VD / best other"),
        ("masked RMSE, MB and PLW", 2.08, mean(100 * (behind - 1)), "mean of VD / best other - 1"),
        ("fewer switches, synthetic without KTS", 40.33, 100 * (1 - without_kts / real_switches),
         "1 - mean / mean of LN, MB"),
        ("fewer switches, all synthetic", 40.33, 100 * (1 - all_four / real_switches), "1 - mean / mean of LN, MB"),
        ("pipelined over not pipelined", 21.0, 100 * (fps["VD"] / fps["VD-Nopipe"] - 1), "VD / VD-Nopipe - 1"),
        ("frame rate over the closest other method", 58.0, over_gs, "VD / GS - 1"),
        ("frame rate over prior work, at least", 70.0, over_gs, "VD / GS - 1"),
        ("fusion over inpainting, Jetson", 290.0, 100 * COMPONENTS_MS["fusion"] / COMPONENTS_MS["inpainting"],
         "fusion / inpainting"),
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=["claim", "printed [%]", "by its tables [%]", "how"])


def saturated() -> tuple[int, int]:
    """The number of printed masked errors above `SATURATION`, and the number of all."""
    return int((M_RMSE > SATURATION).sum(axis=None)), M_RMSE.size
