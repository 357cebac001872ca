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
    entry_points={"console_scripts": [f"voxdepth = {NAME}.node:main"]},
)
