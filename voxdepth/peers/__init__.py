"""Comparators: one file each, all behind `voxdepth.types.DepthCorrector`."""
