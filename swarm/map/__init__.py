"""What one drone knows of the space around it, from what its images prove to the course that it may fly.

    percept -> evidence.py -> voxel_map.py -> cost_map.py, with planner.py -> course

`local_map.py` takes the percept in and answers with the course. All but its answers is in the frame of the drone's
odometry.
"""
