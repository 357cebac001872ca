"""VoxDepth as the paper writes it: templates fused from voxels, registered by an affine map, and a median filter."""
