"""Training of the networks of the library on rendered sequences. Only this package uses PyTorch."""

from typing import Literal

MOST_FLIGHTS = 9000
"""Largest number of flights through a world: their seeds stay below those of the clips that are held out."""
TrainedName = Literal["corrector", "convex"]
"""A network that can be trained: of the baseline `learned`, or of the inpainting method `convex`."""
