# SPDX-License-Identifier: Apache-2.0
"""Train a wheeled robot with a 2D lidar to drive itself, and carry the policy to the robot.

    import pm01_nav

    env = pm01_nav.make_env("static", num_envs=512)  # for Stable-Baselines3
    policy = pm01_nav.load_policy("zoo:pm01-static")

Importing this package loads nothing heavy; what it offers is loaded when it is asked for. The
environments register themselves when ``pm01_nav.envs`` is imported, so
``gymnasium.make("pm01_nav.envs:PM01Nav-v1")`` works.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pm01_nav.errors import InputError
    from pm01_nav.front_door import evaluate, load_policy, make_env, make_vec, train
    from pm01_nav.policy import OnnxPolicy
    from pm01_nav.robot import RobotSpec as Robot
    from pm01_nav.robot import load_robot
    from pm01_nav.task.config import TaskConfig
    from pm01_nav.task.tasks import TASKS
    from pm01_nav.worlds.world import World

__version__ = "0.1.0"

__all__ = [
    "TASKS",
    "InputError",
    "OnnxPolicy",
    "Robot",
    "TaskConfig",
    "World",
    "evaluate",
    "load_policy",
    "load_robot",
    "make_env",
    "make_vec",
    "train",
]

_PLACES = {
    "TASKS": ("task.tasks", "TASKS"),
    "InputError": ("errors", "InputError"),
    "OnnxPolicy": ("policy", "OnnxPolicy"),
    "Robot": ("robot", "RobotSpec"),
    "TaskConfig": ("task.config", "TaskConfig"),
    "World": ("worlds.world", "World"),
    "load_robot": ("robot", "load_robot"),
} | {
    name: ("front_door", name)
    for name in ("evaluate", "load_policy", "make_env", "make_vec", "train")
}
"""Name -> the module that has it, and its name there."""


def __getattr__(name: str) -> Any:
    """Load what is asked for (PEP 562)."""
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, attribute = _PLACES[name]
    value = getattr(import_module(f"{__name__}.{module}"), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List what is offered."""
    return sorted({*globals(), *__all__})
