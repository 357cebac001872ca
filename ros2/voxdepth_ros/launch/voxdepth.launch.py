"""Start the node behind the driver of a RealSense camera; other cameras need other topics."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

TOPICS = {
    "image": "/camera/camera/infra1/image_rect_raw",
    "depth": "/camera/camera/depth/image_rect_raw",
    "camera_info": "/camera/camera/depth/camera_info",
}
"""What the node subscribes to, and the topics of realsense2_camera."""


def generate_launch_description() -> LaunchDescription:
    """Describe the node with an argument for each of its topics and one for its parameters."""
    parameters = PathJoinSubstitution([FindPackageShare("voxdepth_ros"), "config", "voxdepth.yaml"])
    arguments = [DeclareLaunchArgument(name, default_value=topic) for name, topic in TOPICS.items()]
    return LaunchDescription(
        [
            *arguments,
            DeclareLaunchArgument("params_file", default_value=parameters),
            Node(
                package="voxdepth_ros",
                executable="voxdepth_node",
                name="voxdepth",
                parameters=[LaunchConfiguration("params_file")],
                remappings=[(name, LaunchConfiguration(name)) for name in TOPICS],
                output="screen",
            ),
        ]
    )
