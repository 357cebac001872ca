"""The default method: visual odometry, a depth memory that is warped to every frame, temporal fusion and inpainting.

All images of depth are processed as disparity `D = f B / z` in pixels of the full image, whatever sensor measured them:
the noise of stereo matching is roughly constant in disparity, and planes are linear in it.
"""
