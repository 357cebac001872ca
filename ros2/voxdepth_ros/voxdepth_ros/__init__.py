"""A ROS 2 node that corrects the depth of a stereo camera."""
