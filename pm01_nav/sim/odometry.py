# SPDX-License-Identifier: Apache-2.0
"""Where the robot believes to be: its true motion with a wrong scale and a heading that drifts.

The errors are the systematic ones of Borenstein and Feng ("Measurement and correction of
systematic odometry errors in mobile robots", 1996): one grows with the distance, as from unequal
wheels, one with the angle turned, as from a wrong wheel separation. They stand for the robot's
whole pose estimate, so the simulated wheels' own errors do not enter a second time.
"""

from __future__ import annotations

import numpy as np

from pm01_nav.compilation import compiled
from pm01_nav.sim.collision import polar, to_base
from pm01_nav.sim.drive_motion import read_twist, write_twist
from pm01_nav.sim.dynamics import wrap
from pm01_nav.sim.random import uniform


@compiled
def begin_odometry(state, errors, drawn, i, key, count):
    """Start with the true pose and a goal that is off by ``goal_error``."""
    # The direction of the goal's error is U(-pi, pi).
    direction, length = np.pi * (2.0 * uniform(key, count, i) - 1.0), drawn.goal_error[i]
    errors.odometry_goal[i, 0] = state.goal[i, 0] + length * np.cos(direction)
    errors.odometry_goal[i, 1] = state.goal[i, 1] + length * np.sin(direction)
    for axis in range(3):
        errors.odometry_pose[i, axis] = state.pose[i, axis]


@compiled
def advance_odometry(state, errors, drawn, i, x, y, yaw):
    """Add the motion from the pose (x, y, yaw) to the present one, as odometry sees it.

    A control step's chord is turned by half of the heading's error, which is exact without one.
    """
    turn = wrap(state.pose[i, 2] - yaw)
    middle = yaw + 0.5 * turn
    dx, dy = state.pose[i, 0] - x, state.pose[i, 1] - y
    ahead, left = to_base(dx, dy, np.cos(middle), np.sin(middle))
    turn += drawn.odometry_drift_per_rad[i] * turn + drawn.odometry_drift_per_m[i] * ahead
    middle = errors.odometry_pose[i, 2] + 0.5 * turn
    cos, sin, scale = np.cos(middle), np.sin(middle), drawn.odometry_scale[i]
    errors.odometry_pose[i, 0] += scale * (cos * ahead - sin * left)
    errors.odometry_pose[i, 1] += scale * (sin * ahead + cos * left)
    errors.odometry_pose[i, 2] = wrap(errors.odometry_pose[i, 2] + turn)


@compiled
def measure(state, errors, drawn, i):
    """Tell the goal and the twist of environment i as odometry has them."""
    pose = errors.odometry_pose
    dx, dy = errors.odometry_goal[i, 0] - pose[i, 0], errors.odometry_goal[i, 1] - pose[i, 1]
    distance, bearing = polar(dx, dy, np.cos(pose[i, 2]), np.sin(pose[i, 2]))
    errors.measured_goal[i, 0], errors.measured_goal[i, 1] = distance, bearing
    v, u, w = read_twist(state.twist, i)
    scale = drawn.odometry_scale[i]
    drift = drawn.odometry_drift_per_rad[i] * w + drawn.odometry_drift_per_m[i] * v
    write_twist(errors.measured_twist, i, scale * v, scale * u, w + drift)
