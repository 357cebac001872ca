"""The default method: visual odometry, a depth memory that is warped to every frame, temporal fusion and inpainting.

All images of depth are processed as disparity `D = f B / z`, whatever sensor measured them: the noise of stereo
matching is roughly constant in disparity, and planes are linear in it. Its pixels are those of the images that were
matched, which may be larger than the depth (`Intrinsics.disparity_scale`).

In the shapes of images, (H, W) is the frame and (h, w) the working resolution. A disparity or depth of 0 is unknown.
"""
