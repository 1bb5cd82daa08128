# SPDX-License-Identifier: Apache-2.0
"""A base that does not do what its controller thinks: late, on other wheels, and slipping."""

from __future__ import annotations

import numpy as np

from pm01_nav.compilation import compiled
from pm01_nav.drives import BOX
from pm01_nav.sim.drive_motion import read_twist, within, write_twist
from pm01_nav.sim.dynamics import clip
from pm01_nav.sim.random import uniform
from pm01_nav.sim.state import BaseParams, CrowdParams, TimeStep


@compiled
def begin_commands(errors, i):
    """Forget the commands of the last episode: what is still on its way stands still."""
    for axis in range(errors.command.shape[1]):
        errors.command[i, axis] = 0.0
        for age in range(errors.command_history.shape[1]):
            errors.command_history[i, age, axis] = 0.0


@compiled
def delayed(errors, drawn, i, command, base):
    """Take in a command (num_envs, axes); return v, u, w that the base is told in this step.

    Within a step in which another command arrives it is the mean of the two, each weighted with the
    time for which it counts, so that the travel is right.
    """
    history = errors.command_history
    whole = int(drawn.command_delay[i])
    part = drawn.command_delay[i] - whole
    v, u, w = read_twist(command, i)
    if whole > 0:
        v, u, w = read_twist(history[i], whole - 1)
    v, u, w = within(v, u, w, base)
    if part > 0.0:
        v_before, u_before, w_before = read_twist(history[i], whole)
        before = within(v_before, u_before, w_before, base)
        v += part * (before[0] - v)
        u += part * (before[1] - u)
        w += part * (before[2] - w)
    for axis in range(history.shape[2]):
        for age in range(history.shape[1] - 1, 0, -1):
            history[i, age, axis] = history[i, age - 1, axis]
        history[i, 0, axis] = command[i, axis]
    return v, u, w


@compiled
def drive(errors, drawn, i, command, base, key, count):
    """Write into ``errors.command`` the twist that the wheels really aim at.

    The controller turns v and w into wheel speeds with the nominal radius and separation; the
    ground turns them back with the true ones. The nominal radius cancels. What goes sideways is
    driven by both sides alike, as on Mecanum wheels.
    """
    v, u, w = delayed(errors, drawn, i, command, base)
    across = 0.5 * base.wheel_separation * w
    left_share = drawn.wheel_left_factor[i] * grip(drawn, i, key, count)
    right_share = drawn.wheel_right_factor[i] * grip(drawn, i, key, count)
    left, right = (v - across) * left_share, (v + across) * right_share
    separation = base.wheel_separation * drawn.wheel_separation_factor[i]
    v, u = 0.5 * (left + right), 0.5 * (left_share + right_share) * u
    write_twist(errors.command, i, v, u, (right - left) / separation)


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
        BOX,
        -np.inf,
        np.inf,
        np.inf,
        np.inf,
        base.linear_acceleration * drawn.acceleration_factor[i],
        base.lateral_acceleration * drawn.acceleration_factor[i],
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
