"""ros2 launch fmfts_ros, with this file and [namespace:=left_arm] [params:=my.yaml]."""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description():
    defaults = PathJoinSubstitution([FindPackageShare("fmfts_ros"), "config", "fmfts.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("namespace", default_value="", description="before all names"),
            DeclareLaunchArgument("params", default_value=defaults, description="file of parameters"),
            Node(
                package="fmfts_ros",
                executable="fmfts",
                name="fmfts",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("params")],
                respawn=True,
                respawn_delay=1.0,
            ),
        ]
    )
