"""The baselines that the default method is compared with: one file each, all behind `voxdepth.types.DepthCorrector`."""
