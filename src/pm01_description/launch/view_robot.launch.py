# SPDX-License-Identifier: Apache-2.0
"""Show the robot in RViz, with sliders that turn its wheels."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import Command, LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Start what publishes the robot's description and joints, and RViz."""
    share = FindPackageShare("pm01_description")
    xacro = PathJoinSubstitution([share, "urdf", "pm01.urdf.xacro"])
    description = Command(["xacro ", xacro, " gazebo:=", LaunchConfiguration("gazebo")])
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "gui", default_value="true", description="Sliders for the wheels, or none."
            ),
            DeclareLaunchArgument(
                "gazebo",
                default_value="none",
                choices=["none", "harmonic", "fortress"],
                description="Whose tags the description holds.",
            ),
            DeclareLaunchArgument(
                "rviz_config",
                default_value=PathJoinSubstitution([share, "rviz", "view_robot.rviz"]),
                description="The file that says what RViz shows.",
            ),
            Node(
                package="robot_state_publisher",
                executable="robot_state_publisher",
                parameters=[{"robot_description": ParameterValue(description, value_type=str)}],
            ),
            Node(
                package="joint_state_publisher_gui",
                executable="joint_state_publisher_gui",
                condition=IfCondition(LaunchConfiguration("gui")),
            ),
            Node(
                package="joint_state_publisher",
                executable="joint_state_publisher",
                condition=UnlessCondition(LaunchConfiguration("gui")),
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", LaunchConfiguration("rviz_config")],
            ),
        ]
    )
