"""What the paper prints, which was measured on other data, and our methods by its names of them."""

import pandas as pd

from voxdepth.registry import AUTHORS, PAPER, installed_names

METHODS = ("VD", "RS", "GS", "DS")
"""VoxDepth, RealSense, GSmooth, DeepSmooth."""
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
"""Printed without a unit; `authors_metrics.py` tells why so many lie just below 180."""
INPAINTING = {"bilinear": (16.35, 8.0), "convex": (34.39, 237.0), "dilation": (17.46, 94.0)}
"""RQ3: PSNR [dB] and time [ms] by method."""
FLOW_S = {"Horn-Schunck": 2.45, "RAFT": 15.5}
"""RQ4: time of one flow [s]."""
SWARM = "Swarm"
"""The paper's name of the drones with perception of their own of Kabore and Gueler, whose rate it quotes."""
FRAMES_PER_S = {"VD": 26.71, "VD-Nopipe": 21.91, "RS": 39.52, "GS": 16.89, "DS": 2.0, SWARM: 14.0}
COMPONENTS_MS = {"fusion": (280.0, 85.0), "inpainting": (94.0, 2.0), "transform": (6.0, 4.0), "combine": (13.0, 3.0)}
"""Mean time on the Jetson Nano and on a workstation."""
MOVEMENT = {50: (6.75, 16.06), 150: (10.08, 12.61)}
"""Mean movement [px] and quality of registration [dB] by the number of frames between two images."""
SWITCHES = {"LN": 10, "MB": 10, "KTS": 4, "KTC": 14, "PLF": 4, "PLW": 5}
"""State switches in `SWITCHES_FRAMES` frames."""
SWITCHES_FRAMES = 500
SEQUENCES = tuple(f"sim-{name}" for name in PSNR_DB.index)
"""Shipped sequences that stand for the datasets, in the paper's order."""

_OURS = {"VD": PAPER, "VD-code": AUTHORS, "RS": "realsense-left", "GS": "lmeds", "DS": "learned", "raw": "raw"}
OURS = {name: method for name, method in _OURS.items() if method in installed_names()}
"""Our method by the paper's name of it, and the depth that all of them receive. DS needs the extra `learned`."""


def dataset(sequence: str) -> str:
    """Return the paper's name of the dataset that a sequence stands for, if it has such a name."""
    return sequence.removeprefix("sim-")


def beside(printed: pd.DataFrame, sequences: pd.Index) -> pd.DataFrame:
    """Return the rows of a printed table for the sequences that stand for its datasets, NaN for others."""
    return printed.reindex(sequences.map(dataset)).set_axis(sequences)


def leads(of: pd.DataFrame) -> pd.Series:
    """Return whether VD is higher than RS and GS, by sequence; sequences without all three are left out."""
    known = of[list(METHODS[:3])].dropna()
    return known["VD"] > known[["RS", "GS"]].max(axis="columns")
