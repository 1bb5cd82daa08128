# SPDX-License-Identifier: Apache-2.0
"""A base that does not do what its controller thinks: late, on other wheels, and slipping."""

from __future__ import annotations

import numpy as np

from pm01_nav.compilation import compiled
from pm01_nav.sim.dynamics import clip
from pm01_nav.sim.random import uniform
from pm01_nav.sim.state import BaseParams, CrowdParams, TimeStep


@compiled
def begin_commands(errors, i):
    """Forget the commands of the last episode: what is still on its way stands still."""
    errors.command[i, 0], errors.command[i, 1] = 0.0, 0.0
    for age in range(errors.command_history.shape[1]):
        errors.command_history[i, age, 0], errors.command_history[i, age, 1] = 0.0, 0.0


@compiled
def delayed(errors, drawn, i, command, base):
    """Take in a command (num_envs, 2); return v, w that the base is told in this step.

    Within a step in which another command arrives it is the mean of the two, each weighted with the
    time for which it counts, so that the travel is right.
    """
    history = errors.command_history
    whole = int(drawn.command_delay[i])
    part = drawn.command_delay[i] - whole
    linear, angular = command[i, 0], command[i, 1]
    if whole > 0:
        linear, angular = history[i, whole - 1, 0], history[i, whole - 1, 1]
    linear, angular = within(linear, angular, base)
    if part > 0.0:
        before = within(history[i, whole, 0], history[i, whole, 1], base)
        linear += part * (before[0] - linear)
        angular += part * (before[1] - angular)
    for age in range(history.shape[1] - 1, 0, -1):
        history[i, age, 0], history[i, age, 1] = history[i, age - 1, 0], history[i, age - 1, 1]
    history[i, 0, 0], history[i, 0, 1] = command[i, 0], command[i, 1]
    return linear, angular


@compiled
def within(linear, angular, base):
    """Return v, w kept within the limits of the base."""
    linear = clip(linear, base.linear_min, base.linear_max)
    return linear, clip(angular, -base.angular_max, base.angular_max)


@compiled
def drive(errors, drawn, i, command, base, key, count):
    """Write into ``errors.command`` the twist that the wheels really aim at.

    The controller turns (v, w) into wheel speeds with the nominal radius and separation; the
    ground turns them back with the true ones. The nominal radius cancels.
    """
    linear, angular = delayed(errors, drawn, i, command, base)
    across = 0.5 * base.wheel_separation * angular
    left, right = linear - across, linear + across
    left *= drawn.wheel_left_factor[i] * grip(drawn, i, key, count)
    right *= drawn.wheel_right_factor[i] * grip(drawn, i, key, count)
    separation = base.wheel_separation * drawn.wheel_separation_factor[i]
    errors.command[i, 0], errors.command[i, 1] = 0.5 * (left + right), (right - left) / separation


@compiled
def grip(drawn, i, key, count):
    """Draw the share of its travel that a wheel keeps in this step."""
    # The share lost is U(slip - noise, slip + noise), kept within [0, 1].
    lost = drawn.slip[i] + drawn.slip_noise[i] * (2.0 * uniform(key, count, i) - 1.0)
    return 1.0 - clip(lost, 0.0, 1.0)


@compiled
def true_base(drawn, i, base):
    """Return the base of environment i.

    It has no limits of speed: commands are kept within the nominal ones before the wheels' errors.
    """
    return BaseParams(
        -np.inf,
        np.inf,
        np.inf,
        base.linear_acceleration * drawn.acceleration_factor[i],
        base.angular_acceleration * drawn.acceleration_factor[i],
        base.radius,
        base.vertices,
        base.edges,
        base.wheel_separation,
        drawn.footprint_padding[i],
    )


@compiled
def true_time(drawn, i, time, key, count):
    """Draw how long this control step of environment i takes."""
    # The control period is U(1 - jitter, 1 + jitter) times the nominal one.
    dt = time.dt * (1.0 + drawn.control_jitter[i] * (2.0 * uniform(key, count, i) - 1.0))
    lag = drawn.actuator_lag[i]
    return TimeStep(dt, time.substeps, np.exp(-dt / lag) if lag > 0.0 else 0.0)


@compiled
def true_crowd(crowd, time):
    """Return how movers are stepped in a control step that takes the ``time`` it takes."""
    if len(crowd) == 0:
        return crowd
    return CrowdParams(crowd.model, crowd.avoid_robot, time.substeps * time.dt)
