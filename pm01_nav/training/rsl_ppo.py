# SPDX-License-Identifier: Apache-2.0
"""PPO from rsl_rl, made for thousands of robots: experience never leaves the device.

On a GPU one CUDA graph holds a whole rollout: policy, simulator, task and returns. Launched one by
one, their thousands of small kernels would take ten times as long.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from rsl_rl.algorithms import PPO
from rsl_rl.models import MLPModel
from rsl_rl.modules import GaussianDistribution
from rsl_rl.storage import RolloutStorage
from stable_baselines3.common.logger import Logger
from tensordict import TensorDict

from pm01_nav.errors import InputError
from pm01_nav.task.navigation import NavigationBatch
from pm01_nav.task.outcomes import Episodes, MaskedStep
from pm01_nav.training.algorithms.ppo import PPOConfig
from pm01_nav.training.budget import Budget
from pm01_nav.training.ppo import make_policy

if TYPE_CHECKING:
    from pm01_nav.training.supervision import Supervision

GROUP = "policy"
"""rsl_rl's name for a group of observations; we have one."""
WARM_UP_ROLLOUTS = 2
"""Rollouts before one is recorded: what is compiled or allocated once must be there by then."""


class RslRlLearner:
    """rsl_rl's PPO with the attributes of SB3's that a run needs: one loop watches over both."""

    logger: Logger

    def __init__(
        self, config: PPOConfig, batch: NavigationBatch, *, seed: int, budget: Budget
    ) -> None:
        """Build the learner where ``batch`` keeps its arrays."""
        torch.manual_seed(seed)
        device = torch.device(batch.arrays.place)
        if device.type == "cuda":
            torch.set_float32_matmul_precision("high")  # TF32
        self.config, self.batch, self._budget = config, batch, budget
        self.policy = make_policy(config, batch.layout)
        """A copy on the CPU, by SB3's names: what is evaluated, stored and exported."""
        self.num_timesteps = 0
        self._n_updates = 0
        self._seeds = (seed << 32) + np.arange(batch.num_envs)
        self._last_obs = np.zeros((batch.num_envs, batch.layout.size), dtype=np.float32)
        self._last_episode_starts = np.zeros(batch.num_envs, dtype=np.bool_)
        self._algorithm = make_algorithm(config, batch, device)
        self.policy.optimizer = self._algorithm.optimizer
        self._rollouts = Rollouts(self._algorithm, batch, config)

    def set_logger(self, logger: Logger) -> None:
        """Write metrics to ``logger``."""
        self.logger = logger

    def begin(self) -> None:
        """Start new episodes everywhere."""
        self._last_obs = self.batch.arrays.to_numpy(self.batch.reset(self._seeds))

    def learn(self, watch: Supervision) -> None:
        """Collect and learn in turn until ``watch`` has had enough."""
        watch.watch(self)
        copy_weights(self.policy, self._algorithm)
        self._rollouts.begin(self._last_obs)
        samples = self.config.n_envs * self.config.n_steps
        while watch.between_iterations(self.num_timesteps):
            watch.note(self._rollouts.collect())
            self._update()
            self.num_timesteps += samples
            self._publish()

    def _update(self) -> None:
        left = 1.0 - (1.0 - self.config.learning_rate_final) * self._budget.learning_fraction()
        rate = self.config.learning_rate * left
        for group in self._algorithm.optimizer.param_groups:
            group["lr"] = rate
        losses = self._algorithm.update()
        self._n_updates += 1
        if not all(math.isfinite(loss) for loss in losses.values()):
            raise InputError(f"training diverged ({losses}); lower train.ppo.learning_rate")
        for name, loss in losses.items():
            self.logger.record(f"train/{name}", loss)
        self.logger.record("train/learning_rate", rate)
        self.logger.dump(self.num_timesteps)

    def _publish(self) -> None:
        """Bring what is evaluated and stored up to date."""
        state = self.policy.state_dict()
        for name, parameter in parameters(self._algorithm).items():
            state[name].copy_(parameter.detach())
        self._last_obs = self._rollouts.observation.numpy(force=True)


class Gaussian(GaussianDistribution):
    """rsl_rl's distribution of actions, drawn in a way that a CUDA graph can hold.

    ``torch.normal``, which it draws with, looks at the deviations on the CPU each time.
    """

    def sample(self) -> torch.Tensor:
        """Draw actions (num_envs, axes)."""
        return self.mean + self.std * torch.randn_like(self.mean)


def make_algorithm(config: PPOConfig, batch: NavigationBatch, device: torch.device) -> PPO:
    """Return rsl_rl's PPO with the settings that SB3's has from the same configuration."""
    example = _grouped(torch.zeros(batch.num_envs, batch.layout.size, device=device))
    axes = batch.layout.drive.size
    sets = {"actor": [GROUP], "critic": [GROUP]}
    network = {"hidden_dims": list(config.net_arch), "activation": config.activation}
    spread: dict[str, Any] = {"class_name": Gaussian, "init_std": math.exp(config.log_std_init)}
    spread["std_type"] = "log"
    actor = MLPModel(example, sets, "actor", axes, **network, distribution_cfg=spread)
    critic = MLPModel(example, sets, "critic", 1, **network)
    storage = RolloutStorage("rl", batch.num_envs, config.n_steps, example, [axes], str(device))
    return PPO(
        actor,
        critic,
        storage,
        num_learning_epochs=config.n_epochs,
        num_mini_batches=config.n_envs * config.n_steps // config.batch_size,
        clip_param=config.clip_range,
        gamma=config.gamma,
        lam=config.gae_lambda,
        value_loss_coef=config.vf_coef,
        entropy_coef=config.ent_coef,
        learning_rate=config.learning_rate,
        max_grad_norm=config.max_grad_norm,
        use_clipped_value_loss=False,
        schedule="fixed",
        normalize_advantage_per_mini_batch=True,
        device=str(device),
    )


def parameters(algorithm: PPO) -> dict[str, torch.Tensor]:
    """Return the networks' parameters by the names that SB3's policy gives them."""
    named: dict[str, torch.Tensor] = {}
    for model, body, head in (
        (algorithm.actor, "policy_net", "action_net"),
        (algorithm.critic, "value_net", "value_net"),
    ):
        layers = [layer for layer in model.mlp if isinstance(layer, torch.nn.Linear)]
        names = [f"mlp_extractor.{body}.{2 * k}" for k in range(len(layers) - 1)] + [head]
        for name, layer in zip(names, layers, strict=True):
            named |= {f"{name}.weight": layer.weight, f"{name}.bias": layer.bias}
    distribution: Any = algorithm.actor.distribution
    return named | {"log_std": distribution.log_std_param}


def copy_weights(policy: torch.nn.Module, algorithm: PPO) -> None:
    """Begin with the weights of an SB3 policy."""
    state = policy.state_dict()
    with torch.no_grad():
        for name, parameter in parameters(algorithm).items():
            parameter.copy_(state[name])


class Rollouts:
    """Experience of ``n_steps`` steps of every robot, collected into rsl_rl's storage."""

    def __init__(self, algorithm: PPO, batch: NavigationBatch, config: PPOConfig) -> None:
        """Make room for one rollout."""
        self._algorithm, self._batch, self._config = algorithm, batch, config
        place = algorithm.device
        shape, rows = (config.n_steps, batch.num_envs), len(batch.config.rewards)
        self.observation = torch.zeros(batch.num_envs, batch.layout.size, device=place)
        scale = [1.0] * batch.layout.size if batch.layout.normalize else batch.layout.scale
        self._scale = torch.tensor(scale, device=place)
        self._endings = {
            "success": torch.zeros(shape, dtype=torch.bool, device=place),
            "collision": torch.zeros(shape, dtype=torch.bool, device=place),
            "done": torch.zeros(shape, dtype=torch.bool, device=place),
            "steps": torch.zeros(shape, dtype=torch.int64, device=place),
            "world": torch.zeros(shape, dtype=torch.int64, device=place),
            "returns": torch.zeros(shape, dtype=torch.float64, device=place),
        }
        self._terms = torch.zeros(rows, dtype=torch.float64, device=place)
        self._recorded: torch.cuda.CUDAGraph | None = None
        self._count = 0

    def begin(self, observation: NDArray[np.float32]) -> None:
        """Go on from these observations (num_envs, size)."""
        self.observation.copy_(torch.from_numpy(observation))

    def collect(self) -> Episodes | None:
        """Collect a rollout; return the episodes that ended in it, if any."""
        if self._recorded is not None:
            self._recorded.replay()
        elif self._count < WARM_UP_ROLLOUTS or not self._recordable:
            self._roll_out()
        else:
            self._record()
        self._count += 1
        return self._episodes()

    @property
    def _recordable(self) -> bool:
        """Whether a graph can hold a rollout: where the last scans lie must be as it was before."""
        repeats = self._config.n_steps % self._batch.observer.period == 0
        return self.observation.is_cuda and repeats

    def _record(self) -> None:
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph):
            self._roll_out()
        self._recorded = graph
        graph.replay()

    @torch.no_grad()
    def _roll_out(self) -> None:
        algorithm = self._algorithm
        self._terms.zero_()
        algorithm.storage.clear()
        observation = self.observation
        for t in range(self._config.n_steps):
            action = algorithm.act(_grouped(observation / self._scale))
            step = self._step(action.double())
            observation = step.observation
            self._note(t, step)
            algorithm.process_env_step(
                _grouped(observation / self._scale),
                (self._config.reward_scale * step.reward).float(),
                step.terminated | step.truncated,
                {"time_outs": step.truncated},
            )
        self.observation.copy_(observation)
        algorithm.compute_returns(_grouped(observation / self._scale))

    def _step(self, action: torch.Tensor) -> MaskedStep:
        """Step the batch, whose arrays are torch's on a GPU and numpy's on the CPU."""
        given = action if self._batch.arrays.device == "cuda" else action.numpy()
        return MaskedStep(*(torch.as_tensor(value) for value in self._batch.step_all(given)))

    def _note(self, t: int, step: MaskedStep) -> None:
        done = step.terminated | step.truncated
        for name, value in (
            ("done", done),
            ("success", step.success),
            ("collision", step.terminated & ~step.success),
            ("steps", step.steps),
            ("world", step.world),
            ("returns", step.returns),
        ):
            self._endings[name][t] = value
        self._terms += (step.term_sums * done).sum(dim=1)

    def _episodes(self) -> Episodes | None:
        row, index = torch.nonzero(self._endings["done"], as_tuple=True)
        count = len(row)
        if count == 0:
            return None
        ended = {n: v[row, index].numpy(force=True) for n, v in self._endings.items()}
        means = (self._terms / count).tolist()
        terms = zip(self._batch.config.rewards, means, strict=True)
        return Episodes(
            indices=index.numpy(force=True),
            world=ended["world"],
            success=ended["success"],
            collision=ended["collision"],
            steps=ended["steps"],
            returns=ended["returns"],
            terms={name: np.array([mean]) for name, mean in terms},
            final_observation=np.zeros((0, self._batch.layout.size), dtype=np.float32),
        )


def _grouped(observation: torch.Tensor) -> TensorDict:
    return TensorDict({GROUP: observation}, batch_size=[len(observation)])
