"""Numbers of the paper beside those of its table of quality: measured on other data, most on a Jetson Nano."""

INPAINTING = {"bilinear": (16.35, 8), "convex upsampling (learned)": (34.39, 237), "dilation": (17.46, 94)}
"""RQ3: PSNR [dB] and time [ms] by method."""
FLOW_S = {"Horn-Schunck": 2.45, "RAFT": 15.5}
"""RQ4: time of one flow [s]."""
FRAMES_PER_S = {"VD": 26.71, "VD-Nopipe": 21.91, "RS": 39.52, "GS": 16.89, "DS": 2.0}
COMPONENTS_MS = {"fusion": (280, 85), "inpainting": (94, 2), "transform": (6, 4), "combine": (13, 3)}
"""Mean time on the Jetson Nano and on a workstation."""
MOVEMENT = {50: (6.75, 16.06), 150: (10.08, 12.61)}
"""Pixels moved and quality of registration [dB], by the frames between two images."""
SWITCHES = {"LN": 10, "MB": 10, "KTS": 4, "KTC": 14, "PLF": 4, "PLW": 5}
"""State switches in 500 frames."""
SWITCHES_FRAMES = 500
