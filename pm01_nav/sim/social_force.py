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
NEGLIGIBLE = 6.0
"""Forces below exp(-6) of their strength count as none."""


@compiled(allocates=False)
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
    cosine, sine = dx * ex + dy * ey, dx * ey - dy * ex
    # The angle's sine bounds the angle from below: most forces need no exponential.
    least_turn = TURN_DECAY * REACH * (sine if cosine > 0.0 else length)
    if gap > NEGLIGIBLE * scale or least_turn * least_turn > NEGLIGIBLE:
        return 0.0, 0.0
    angle = np.arctan2(sine, cosine) + scale * SIDE_BIAS
    slow, turn = SLOW_DECAY * scale * angle, TURN_DECAY * scale * angle
    force = STRENGTH * np.exp(-gap / scale) / length
    back = force * np.exp(-slow * slow)
    aside = force * np.exp(-turn * turn) * (1.0 if angle > 0.0 else -1.0)
    return -back * dx + aside * dy, -back * dy - aside * dx


@compiled(allocates=False)
def wall_repulsion(gap):
    """Return the acceleration away from a wall at the distance ``gap`` [m]."""
    if gap > NEGLIGIBLE * WALL_REACH:
        return 0.0
    return WALL_STRENGTH * np.exp(-max(gap, 0.0) / WALL_REACH)
