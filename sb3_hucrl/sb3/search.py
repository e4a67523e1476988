"""Policy search by SB3 algorithms: one adapter for each kind, in the shape of :class:`sb3_hucrl.loop.Search`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch as th
from sb3_contrib import ARS
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import DictReplayBuffer, ReplayBuffer
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

from sb3_hucrl.algorithms import HMPC
from sb3_hucrl.imagination import BatchActor, World
from sb3_hucrl.loop import Loop
from sb3_hucrl.planning import MPCPolicy
from sb3_hucrl.sb3.actors import planner_actor, policy_actor
from sb3_hucrl.sb3.layer_norm import insert_layer_norm
from sb3_hucrl.sb3.parameters import Parameters
from sb3_hucrl.sb3.policy import SB3Policy
from sb3_hucrl.sb3.replay import MixedReplayBuffer, keep_latest, real_buffer
from sb3_hucrl.sb3.running import RunningLearn
from sb3_hucrl.sb3.standardise import insert_extractors, standardise
from sb3_hucrl.wrappers import ImaginationVecEnv


class SB3Search:
    """
    What all SB3 algorithms have in common.

    :param model: in training
    :param env: the ImaginationVecEnv that it trains on
    :param loop: that the search belongs to
    :raises ValueError: if the algorithm cannot search in imagination as it is set up
    """

    #: imagination steps all environments as one batch, which is slow with fewer
    min_envs = 2
    #: whether its policies can be made with a features extractor
    extracts_features = True

    def __init__(self, model: BaseAlgorithm, env: ImaginationVecEnv, loop: Loop) -> None:
        if env.num_envs < self.min_envs:
            raise ValueError(
                f"n_envs is {env.num_envs}: imagination steps all environments as one batch and needs at least "
                f"{self.min_envs}; make 32 or so, for example make_vec_env(..., n_envs=32)"
            )
        self.model, self._env, self._loop = model, env, loop
        self._planner: MPCPolicy | None = None
        self._is_training = RunningLearn(model)
        # A policy that has learned from observations as they are would no longer know what it sees.
        if loop.state.real_steps == 0 and model._n_updates == 0:
            self._prepare_networks()
        self._plan_in(loop.world)

    def _prepare_networks(self) -> None:
        """Change those of a new policy."""
        if self._loop.settings.search.standardise and self.extracts_features:
            insert_extractors(self.model)

    def _plan_in(self, world: World) -> None:
        """Make the planner anew; at the start around an unfitted model, so that what does not fit is found at once."""
        settings = self._loop.settings.planning
        if settings is not None:
            policy = SB3Policy(self.model) if settings.needs_policy else None
            self._planner = settings.build(world, policy, self._loop.state.fork_seed())

    def restart(self, world: World) -> None:
        """
        Search in a new world from now on, with trajectories that begin there.

        :param world: to search in
        """
        self._env.imagine(world, is_training=self._is_training)
        self._plan_in(world)
        self._renew_replay()
        standardise(self.model, world)
        self._restart_trajectories()

    def _renew_replay(self) -> None:
        """Forget, where there is something to forget, what older worlds gave."""

    def _restart_trajectories(self) -> None:
        model = self.model
        env = model.get_env()
        assert env is not None  # an algorithm in training has one
        # SB3 keeps the observation to act on next here, and resets it only when training begins.
        model._last_obs = env.reset()  # type: ignore[assignment]  # typed without dictionary observations
        model._last_episode_starts = np.ones((env.num_envs,), dtype=bool)

    def imagines(self) -> bool:
        """
        :return: whether the environments are imagined now
        """
        return self._env.trajectories is not None

    @property
    def steps(self) -> int:
        """Timesteps so far, those before an interruption included."""
        start = self._loop.state.search_start
        assert start is not None  # as the loop was made for this algorithm
        return self.model.num_timesteps - start

    @property
    def is_over(self) -> bool:
        """Whether it is time for real episodes."""
        return self.steps >= self._loop.imagined_steps

    def total_timesteps(self, handed_over: Mapping[str, Any]) -> int:
        """
        :param handed_over: the variables of ``learn()`` that SB3 hands to callbacks when training starts
        :return: at which training ends; it counts from the first call of ``learn()`` that was not told to reset
        """
        return int(handed_over["total_timesteps"])

    def actor(self, deterministic: bool) -> BatchActor:
        """The policy, see :class:`sb3_hucrl.loop.Search`."""
        return policy_actor(self.model, deterministic)

    def planner(self, deterministic: bool) -> BatchActor | None:
        """The planner, if any. An episode that samples the policy explores, which planning around it would undo."""
        settings = self._loop.settings.planning
        if self._planner is None or settings is None or (settings.needs_policy and not deterministic):
            return None
        return planner_actor(self._planner)

    def parameters(self) -> Parameters | None:
        """A copy of policy and critics."""
        return Parameters.of(self.model)

    def restore(self, parameters: Parameters) -> None:
        """
        :param parameters: the search goes on from them
        """
        parameters.restore(self.model)

    def diagnostics(self) -> dict[str, float]:
        """Mean return of the latest trajectories that began where real episodes begin."""
        trajectories = self._env.trajectories
        if trajectories is None or not trajectories.initial_returns:
            return {}
        return {"return": float(np.mean(trajectories.initial_returns[-self._env.num_envs :]))}


class OffPolicySearch(SB3Search):
    """Algorithms with a replay buffer."""

    model: OffPolicyAlgorithm

    def __init__(self, model: OffPolicyAlgorithm, env: ImaginationVecEnv, loop: Loop) -> None:
        buffer, settings = model.replay_buffer, loop.settings.search
        if isinstance(buffer, DictReplayBuffer):
            raise ValueError(
                f"the replay buffer is a {type(buffer).__name__}, for observations that are dictionaries: imagination "
                "has vectors; leave replay_buffer_class out (hindsight relabelling is not supported)"
            )
        if buffer is not None and buffer.n_envs != env.num_envs:
            raise ValueError(
                f"the replay buffer has rows of {buffer.n_envs} environments, and n_envs is {env.num_envs}: load one "
                f"that was saved with n_envs={env.num_envs}, or make {buffer.n_envs} environments"
            )
        mixes = settings.real_data_fraction > 0 or settings.stale_fraction > 0
        if model.optimize_memory_usage and mixes:
            raise ValueError(
                "optimize_memory_usage stores no next observations, which real_data_fraction and stale_fraction need: "
                "set optimize_memory_usage=False"
            )
        super().__init__(model, env, loop)
        self._aim_for_real_entropy()

    def _prepare_networks(self) -> None:
        super()._prepare_networks()
        insert_layer_norm(self.model)

    def _aim_for_real_entropy(self) -> None:
        """
        SB3's automatic entropy target is minus the number of all action dimensions. Hallucinated ones stay random for
        free once the model is sure, so that all of the loss of entropy would fall on the real action, which would stop
        exploring. So the automatic target becomes minus the number of real dimensions; any other value stays.
        """
        model, problem = self.model, self._loop.problem
        automatic, wanted = -float(problem.action_space.shape[0]), -float(problem.action_dim)
        if getattr(model, "target_entropy", None) == automatic != wanted:
            model.target_entropy = wanted  # type: ignore[attr-defined]  # of SAC and its relatives
            model.logger.info(f"target_entropy is {wanted:g}: hallucinated dimensions do not count")

    def _renew_replay(self) -> None:
        loop, settings = self._loop, self._loop.settings.search
        buffer = self.model.replay_buffer
        assert buffer is not None  # an off-policy algorithm in training has one
        imagined: ReplayBuffer = buffer.imagined if isinstance(buffer, MixedReplayBuffer) else buffer
        # What the last model imagined may contradict the new one.
        keep_latest(imagined, settings.stale_fraction)
        if settings.real_data_fraction > 0:
            rng = np.random.default_rng(loop.state.draw_seed())
            real = real_buffer(imagined, loop.state.dataset, loop.problem.task, loop.problem.action_space, rng)
            self.model.replay_buffer = MixedReplayBuffer(imagined, real, settings.real_data_fraction)
        else:
            self.model.replay_buffer = imagined

    def _restart_trajectories(self) -> None:
        super()._restart_trajectories()
        # What goes into the replay buffer next is the observation before VecNormalize.
        normalizer = self.model.get_vec_normalize_env()
        if normalizer is not None:
            self.model._last_original_obs = normalizer.get_original_obs()


class OnPolicySearch(SB3Search):
    """Algorithms with a rollout buffer."""

    model: OnPolicyAlgorithm

    def _restart_trajectories(self) -> None:
        super()._restart_trajectories()
        self.model.rollout_buffer.reset()


class ARSSearch(SB3Search):
    """Augmented random search, which evaluates its policies one after another."""

    model: ARS
    min_envs = 1
    extracts_features = False

    def total_timesteps(self, handed_over: Mapping[str, Any]) -> int:
        # Its ``total_timesteps`` is what this call of learn() adds.
        return int(handed_over["total_steps"])

    def restore(self, parameters: Parameters) -> None:
        super().restore(parameters)
        # It searches around this vector and overwrites the policy with it.
        weights = th.nn.utils.parameters_to_vector(self.model.policy.parameters()).detach()
        self.model.weights = weights  # type: ignore[assignment]  # typed as the None that it is at first


class PlanningSearch(SB3Search):
    """H-MPC, which plans and searches no policy."""

    model: HMPC
    min_envs = 1

    def __init__(self, model: HMPC, env: ImaginationVecEnv, loop: Loop) -> None:
        if loop.settings.planning is None:
            raise ValueError(
                "planner is None, and H-MPC only plans: give learn() callback=HUCRLCallback(planner='icem')"
            )
        super().__init__(model, env, loop)

    def _plan_in(self, world: World) -> None:
        super()._plan_in(world)
        self.model.planning, self.model.recipe = self._loop.settings.planning, self._loop.recipe
        self.model.planner = self._planner

    @property
    def is_over(self) -> bool:
        """There is no policy to search: a timestep stands for a whole search."""
        return self.steps >= min(1, self._loop.imagined_steps)

    def parameters(self) -> None:
        """Nothing: there is no policy to choose."""


def make_search(model: BaseAlgorithm, env: ImaginationVecEnv, loop: Loop) -> SB3Search:
    """
    :param model: in training
    :param env: the ImaginationVecEnv that it trains on
    :param loop: that the search belongs to
    :raises ValueError: if the algorithm cannot search in imagination as it is set up
    """
    if isinstance(model, HMPC):
        return PlanningSearch(model, env, loop)
    if isinstance(model, ARS):
        return ARSSearch(model, env, loop)
    if isinstance(model, OffPolicyAlgorithm):
        return OffPolicySearch(model, env, loop)
    if isinstance(model, OnPolicyAlgorithm):
        return OnPolicySearch(model, env, loop)
    return SB3Search(model, env, loop)
