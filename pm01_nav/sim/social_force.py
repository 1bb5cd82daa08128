# SPDX-License-Identifier: Apache-2.0
"""The social force model (Helbing and Molnar, Phys. Rev. E 51, 1995) in its measured form.

Forces and constants are those that Moussaid et al. (Proc. R. Soc. B 276, 2009) found by tracking
people in a corridor, per unit of mass [m/s^2]. Distances are taken between surfaces, so that discs
of any size fit. The force on the other of two is the opposite one.
"""

from __future__ import annotations

import numpy as np

from pm01_nav.compilation import compiled

RELAXATION = 0.54
"""Time in which a pedestrian takes up the wanted velocity [s]."""
STRENGTH = 4.5
"""A [m/s^2]."""
REACH = 0.35
"""gamma: how far a force reaches, for each unit of the interaction vector [m]."""
TURN_DECAY, SLOW_DECAY = 2.0, 3.0
"""n and n': how fast turning, and slowing down, fade with the angle [1/m]."""
RELATIVE_SPEED = 2.0
"""lambda: the weight of the relative velocity in the interaction vector [s/m]."""
SIDE_BIAS = 0.005
"""epsilon: the preference for passing on the right [1/m]."""
WALL_STRENGTH, WALL_REACH = 3.0, 0.1
"""a [m/s^2] and b [m] of the force of a wall."""


@compiled
def repulsion(px, py, vx, vy, reach):
    """Return the acceleration ax, ay [m/s^2] that another body causes.

    ``px``, ``py`` lead to the other [m], ``vx``, ``vy`` are one's own velocity less the other's,
    ``reach`` is the sum of both radii.
    """
    distance = max(np.sqrt(px * px + py * py), 1e-9)
    ex, ey = px / distance, py / distance
    dx, dy = RELATIVE_SPEED * vx + ex, RELATIVE_SPEED * vy + ey
    length = max(np.sqrt(dx * dx + dy * dy), 1e-9)
    scale = REACH * length
    gap = max(distance - reach, 0.0)
    angle = turn_of(dx * ex + dy * ey, dx * ey - dy * ex) + scale * SIDE_BIAS
    slow, turn = SLOW_DECAY * scale * angle, TURN_DECAY * scale * angle
    force = STRENGTH * decay(gap / scale) / length
    back = force * decay(slow * slow)
    aside = force * decay(turn * turn)
    aside = aside if angle > 0.0 else -aside
    return -back * dx + aside * dy, -back * dy - aside * dx


@compiled
def turn_of(cosine, sine):
    """Return the angle of a vector (cosine, sine) of any length, to 2e-5 rad.

    By the polynomial 4.4.49 of Abramowitz and Stegun for the arc tangent on [0, 1]: unlike the
    library's function, a loop can work it out for several vectors at a time.
    """
    c, s = abs(cosine), abs(sine)
    z = min(c, s) / max(c, s, 1e-300)
    q = z * z
    angle = z * (0.9998660 + q * (-0.3302995 + q * (0.1801410 + q * (-0.0851330 + q * 0.0208351))))
    angle = 0.5 * np.pi - angle if s > c else angle
    angle = np.pi - angle if cosine < 0.0 else angle
    return angle if sine >= 0.0 else -angle


@compiled
def decay(x):
    """Return exp(-x) for x >= 0, to 1e-6 of itself up to x = 8 and less exactly beyond.

    exp(-x / 64) by its series, and six times squared; like ``turn_of``, for several at a time.
    """
    y = min(x, 64.0) * (1.0 / 64.0)
    value = 1.0 - y * (
        1.0 - y * (1 / 2) * (1.0 - y * (1 / 3) * (1.0 - y * (1 / 4) * (1.0 - y * (1 / 5))))
    )
    for _ in range(6):
        value *= value
    return value


@compiled
def wall_repulsion(gap):
    """Return the acceleration away from a wall at the distance ``gap`` [m]."""
    return WALL_STRENGTH * decay(max(gap, 0.0) / WALL_REACH)
