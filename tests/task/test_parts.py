# SPDX-License-Identifier: Apache-2.0
"""A part of one's own: no file of the package knows of it, and the robot sees what it learned."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from pm01_nav.arrays import Arrays, array_namespace
from pm01_nav.policy import OnnxPolicy
from pm01_nav.task.config import TaskConfig, observation_layout
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.parts import PARTS, Memory, ObservationPart, Seen, observation_part
from pm01_nav.task.tasks import task_config
from pm01_nav.task.worlds import world_pool
from pm01_nav.training.config import RunConfig, TrainConfig
from pm01_nav.training.run_folder import RunFolder
from pm01_nav.training.trainer import train
from tests.training.progress import Quiet


class Before(Memory):
    """What was shown a step ago."""

    def __init__(self, part: SideClearance, count: int, arrays: Arrays) -> None:
        self._part = part
        self.rows = arrays.xp.zeros((2, count, 2), dtype=arrays.xp.float32, device=arrays.place)

    def begin(self, seen: Seen) -> None:
        self.rows[:, seen.robots] = self._part.sides(seen)

    def begin_where(self, begins: Any, seen: Seen) -> None:
        self.rows[:, begins] = self._part.sides(seen)[begins]

    def push(self, seen: Seen) -> None:
        for _ in range(seen.elapsed.steps):
            self.rows[1] = self.rows[0]
            self.rows[0] = self._part.sides(seen)

    def keep(self, robots: Any) -> None:
        self.rows = self.rows[:, robots]

    def arrays(self) -> dict[str, Any]:
        return {"sides": self.rows}


@dataclass(frozen=True)
class SideClearance(ObservationPart):
    """The nearest return to the right and to the left, now and a step ago."""

    name = "side_clearance"
    unit = "m"

    reach: float = 2.0

    @property
    def shape(self) -> tuple[int, ...]:
        return (2, 2)

    @property
    def bounds(self) -> tuple[float, float]:
        return 0.0, self.reach

    def memory(self, count: int, control_dt: float, arrays: Arrays) -> Memory:
        return Before(self, count, arrays)

    def show(self, seen: Seen, memory: Any) -> tuple[Any, ...]:
        return tuple(memory.rows[:, seen.robots])

    def sides(self, seen: Seen) -> Any:
        """Beams count from behind, counter-clockwise: the first half is to the right."""
        xp = array_namespace(seen.ranges)
        half = self.lidar.num_beams // 2
        right, left = (xp.min(r, axis=-1) for r in (seen.ranges[:, :half], seen.ranges[:, half:]))
        return xp.minimum(xp.maximum(xp.stack([right, left], axis=-1), 0.0), self.reach)


@pytest.fixture
def own_part() -> Iterator[None]:
    observation_part(SideClearance)
    yield
    del PARTS["side_clearance"]


def with_part(**parameters: Any) -> TaskConfig:
    config = task_config("static").model_dump() | {"num_worlds": 4}
    config["observation"] |= {
        "parts": {"side_clearance": parameters},
        "frames": {"count": 1, "interval_s": 0.2},
    }
    return TaskConfig.model_validate(config)


@pytest.mark.usefixtures("own_part")
def test_a_part_is_trained_exported_and_seen_alike_on_a_robot(tmp_path) -> None:
    config = with_part(reach=1.5)
    ppo = {"n_envs": 4, "n_steps": 64, "batch_size": 64, "n_epochs": 1, "net_arch": (8, 8)}
    options = {"steps": 512, "eval_every": 512, "eval_episodes": 4, "threads": 1, "ppo": ppo}
    run = RunConfig(task=config, train=TrainConfig.model_validate(options))
    train(run, RunFolder(tmp_path / "run"), Quiet(), started_at=time.perf_counter())
    policy = OnnxPolicy(tmp_path / "run" / "policy.onnx", config.robot_spec())
    assert policy.metadata["format"] == 2
    listed = policy.metadata["observation"]["parts"]
    assert listed[-1] == {"part": "side_clearance", "reach": 1.5}
    layout = policy.layout
    assert layout.places["side_clearance"] == slice(layout.size - 4, layout.size)

    batch = NavigationBatch(config, world_pool(config, "train", 4), 6, autoreset=False)
    seen = [batch.reset(np.arange(6))]
    network, shown = policy._network, []
    policy._network = lambda rows: (shown.append(rows), network(rows))[1]
    scale = np.array(layout.scale, dtype=np.float32)
    for _ in range(12):
        sim = batch.simulator
        polar = sim.measured_goal
        goal = polar[:, :1] * np.stack([np.cos(polar[:, 1]), np.sin(polar[:, 1])], axis=-1)
        command = policy.act(sim.scan, goal, sim.measured_twist)
        seen.append(batch.step(layout.drive.to_action(command)).observation)
    sides = np.array(shown)[..., -4:]
    # It is there, and what is a step old is what was new a step ago.
    assert np.ptp(sides, axis=0).max() > 0.01
    assert (sides[1:, :, 2:] == sides[:-1, :, :2]).all()
    # Goals go through x and y once more, and divisions are rounded: some 1e-7 of 1.
    assert np.array(seen[:-1]) == pytest.approx(np.array(shown) / scale, abs=2e-6)


@pytest.mark.usefixtures("own_part")
def test_unknown_parts_and_parameters_are_refused() -> None:
    robot = task_config("static").robot_spec()
    with pytest.raises(ValueError, match=r"parts\.side_clearance\.colour: unknown; allowed: reach"):
        observation_layout(with_part(colour=1), robot)
    del PARTS["side_clearance"]
    with pytest.raises(ValueError, match=r"parts\.side_clearance: unknown; allowed: angular_vel"):
        observation_layout(with_part(), robot)
    observation_part(SideClearance)
