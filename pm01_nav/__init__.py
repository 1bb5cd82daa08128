# SPDX-License-Identifier: Apache-2.0
"""Train a wheeled robot with a 2D lidar to drive itself, and carry the policy to the robot.

Importing this package loads nothing heavy. The environments register themselves when
``pm01_nav.envs`` is imported, so ``gymnasium.make("pm01_nav.envs:PM01Nav-v1")`` works.
"""

__version__ = "0.1.0"
