"""Baselines that the default method is compared with. All of them are `voxdepth.types.DepthCorrector`."""
