"""The ROS 2 package, as ament_python installs it."""

from setuptools import setup

NAME = "voxdepth_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/voxdepth.launch.py"]),
        (f"share/{NAME}/config", ["config/voxdepth.yaml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    description="Corrects the depth images of a stereo camera with the library voxdepth",
    license="MIT",
    # The library has a command `voxdepth`.
    entry_points={"console_scripts": [f"voxdepth_node = {NAME}.__main__:main"]},
    # ROS itself, where it comes from a package registry, for Linux.
    extras_require={"wheels": ["ros-diagnostic-msgs", "ros-rclpy", "ros-rmw-fastrtps-cpp", "ros-sensor-msgs"]},
)
