"""The default method: rigid poses, memory in inverse depth, evidence instead of rules, guided filling.

Images of depth are worked on as disparity D = f B / z [px of the full image], whatever measured them: there the noise
of stereo is about the same everywhere, and planes are linear.
"""
