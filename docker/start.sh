#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Train a policy unless there is one, then start Gazebo, the robot and the node that drives it.
set -eo pipefail
source /opt/ros/humble/setup.bash
source /work/install/setup.bash

run=/work/runs/docker
if [ ! -f "$run/policy.onnx" ]; then
  pm01 train --task static --time-budget "${TRAIN_SECONDS:-60}" --out "$run"
fi

ros2 launch pm01_gazebo pm01_world.launch.py "world:=${WORLD:-article}" headless:=true &
ros2 launch pm01_rl navigate.launch.py "policy:=$run/policy.onnx" use_sim_time:=true &
echo "give a goal from another terminal:"
echo "  docker compose exec pm01 bash -lc 'source install/setup.bash && ros2 topic pub --once" \
  "/goal_pose geometry_msgs/msg/PoseStamped \"{header: {frame_id: odom}, pose: {position: {x: 5.0}}}\"'"
wait -n
