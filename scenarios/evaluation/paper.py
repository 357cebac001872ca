"""The numbers that the paper prints in its Table psnr, which were measured on other data by other means."""

METHODS = ("VD", "RS", "GS", "DS")
"""VoxDepth, RealSense, GSmooth, DeepSmooth."""
SEQUENCES = {
    "sim-LN": "LN",
    "sim-MB": "MB",
    "sim-KTS": "KTS",
    "sim-KTC": "KTC",
    "sim-PLF": "PLF",
    "sim-PLW": "PLW",
}
"""The paper's name of the dataset that a shipped sequence stands for, in the paper's order."""
PSNR_DB = {
    "LN": (17.46, 13.04, 13.14, 14.16),
    "MB": (17.10, 13.17, 15.36, 10.51),
    "KTS": (17.69, 14.60, 18.59, 22.87),
    "KTC": (20.32, 17.66, 18.59, 14.89),
    "PLF": (15.81, 13.55, 12.97, 13.62),
    "PLW": (16.05, 13.73, 13.14, 13.37),
}
M_RMSE = {
    "LN": (112.25, 167.25, 179.08, 180.03),
    "MB": (177.61, 175.61, 176.75, 178.04),
    "KTS": (102.23, 139.69, 172.02, 175.68),
    "KTC": (126.15, 144.70, 177.93, 178.89),
    "PLF": (157.95, 159.15, 178.70, 178.38),
    "PLW": (169.79, 164.79, 177.59, 178.87),
}
"""Printed without a unit; see `voxdepth.metrics.m_rmse_u16_wrap` for why so many lie just below 180."""
PUBLISHED = {"psnr16_mm": PSNR_DB, "psnr_minmax8": PSNR_DB, "m_rmse_u16_wrap": M_RMSE}
"""The paper's numbers by the metric that they are compared with."""
