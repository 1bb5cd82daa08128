# SPDX-License-Identifier: Apache-2.0
"""Drive a robot by a policy: ros2 launch pm01_rl navigate.launch.py policy:=policy.onnx."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description() -> LaunchDescription:
    """Start the policy node, and a simulated robot if there is no other."""
    simulate = LaunchConfiguration("simulate")
    use_sim_time = ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)
    stamped = ParameterValue(LaunchConfiguration("cmd_vel_stamped"), value_type=bool)
    policy = ParameterValue(LaunchConfiguration("policy"), value_type=str)
    robot = ParameterValue(LaunchConfiguration("robot"), value_type=str)
    return LaunchDescription(
        [
            DeclareLaunchArgument("policy", description="The policy's file, policy.onnx."),
            DeclareLaunchArgument(
                "robot", default_value="", description="A robot's name or YAML; the policy's own."
            ),
            DeclareLaunchArgument(
                "use_sim_time", default_value="false", description="Time comes from /clock."
            ),
            DeclareLaunchArgument(
                "cmd_vel_stamped", default_value="false", description="TwistStamped, not Twist."
            ),
            DeclareLaunchArgument(
                "simulate", default_value="false", description="Start a simulated robot, too."
            ),
            DeclareLaunchArgument(
                "world", default_value="static", description="Where: a suite, or a world's file."
            ),
            DeclareLaunchArgument(
                "real_time_factor", default_value="1.0", description="Of the simulated robot."
            ),
            Node(
                package="pm01_rl",
                executable="policy_node",
                name="policy_node",
                output="screen",
                parameters=[
                    {
                        "policy": policy,
                        "robot": robot,
                        "use_sim_time": use_sim_time,
                        "cmd_vel_stamped": stamped,
                        "autostart": True,
                    }
                ],
            ),
            Node(
                package="pm01_rl",
                executable="sim_node",
                name="sim_node",
                output="screen",
                condition=IfCondition(simulate),
                parameters=[
                    {
                        "world": ParameterValue(LaunchConfiguration("world"), value_type=str),
                        "cmd_vel_stamped": stamped,
                        "real_time_factor": ParameterValue(
                            LaunchConfiguration("real_time_factor"), value_type=float
                        ),
                    }
                ],
            ),
        ]
    )
