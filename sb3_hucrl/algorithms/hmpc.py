"""H-MPC as an SB3 algorithm: planning without a policy."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import torch as th
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import MaybeCallback, PyTorchObs
from typing_extensions import Self

from sb3_hucrl.algorithms.arguments import Environment
from sb3_hucrl.algorithms.imagined_rollouts import require_no_normalization
from sb3_hucrl.checks import Count, Natural, Seed, validated
from sb3_hucrl.imagination import Learned, WorldRecipe
from sb3_hucrl.planning import MPCPolicy, PlanningSettings


class NoPolicy(BasePolicy):
    """Stands where SB3 expects a policy: it has no parameters, since actions are planned."""

    def _predict(self, observation: PyTorchObs, deterministic: bool = False) -> th.Tensor:
        raise NotImplementedError("H-MPC has no policy: call predict() of the algorithm")


@validated
class HMPC(BaseAlgorithm):
    """
    H-MPC (appendix C.2): every action is planned in the dynamics model that :class:`sb3_hucrl.HUCRLCallback` learns,
    with the planner that the callback names.

    There is no policy to search, so one timestep stands for one (empty) search: ``learn(9)`` plays the callback's
    initial real episodes and nine times its ``real_episodes``.

    :param policy: ``"NoPolicy"``
    :param env: wrapped in an ImaginationVecEnv; one environment is enough
    :param stats_window_size: as in all of SB3's algorithms
    :param tensorboard_log: folder for TensorBoard
    :param verbose: 1 prints what is logged
    :param seed: of all randomness
    :param device: of the dynamics model
    :param _init_setup_model: whether to set up now, or with ``load``
    :raises ValueError: if observations are normalised, which planning has no use for
    """

    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {"NoPolicy": NoPolicy}

    def __init__(
        self,
        policy: str | type[NoPolicy],
        env: Environment,
        stats_window_size: Count = 100,
        tensorboard_log: str | None = None,
        verbose: Natural = 0,
        seed: Seed | None = None,
        device: th.device | str = "auto",
        _init_setup_model: bool = True,
    ) -> None:
        super().__init__(
            policy,
            env,
            learning_rate=0.0,
            stats_window_size=stats_window_size,
            tensorboard_log=tensorboard_log,
            verbose=verbose,
            seed=seed,
            device=device,
            support_multi_env=True,
        )
        #: what to plan and how, once a callback has set it
        self.planning: PlanningSettings | None = None
        #: makes the world to plan in
        self.recipe: WorldRecipe | None = None
        #: what a callback has learned
        self.hucrl: Learned | None = None
        #: plans in the latest world; a loaded algorithm makes it again
        self.planner: MPCPolicy | None = None
        if _init_setup_model:
            self._setup_model()

    def _setup_model(self) -> None:
        require_no_normalization(self)
        self.set_random_seed(self.seed)
        self.policy = self.policy_class(self.observation_space, self.action_space).to(self.device)

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "planner"]

    def learn(
        self,
        total_timesteps: int,
        callback: MaybeCallback = None,
        log_interval: int = 1,
        tb_log_name: str = "HMPC",
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> Self:
        """
        :param total_timesteps: number of rounds of real episodes after the first random ones
        :param callback: with a :class:`sb3_hucrl.HUCRLCallback` that names a planner
        :param log_interval: not needed: the callback logs every real episode
        :param tb_log_name: of the run in TensorBoard
        :param reset_num_timesteps: whether to count from 0, and not on
        :param progress_bar: whether to show one
        :raises ValueError: if the callback names no planner
        """
        total_timesteps, callbacks = self._setup_learn(
            total_timesteps, callback, reset_num_timesteps, tb_log_name, progress_bar
        )
        callbacks.on_training_start(locals(), globals())
        if self.planning is None:
            raise ValueError("H-MPC learns nothing by itself: give learn() callback=HUCRLCallback(planner='icem')")
        while self.num_timesteps < total_timesteps and self._count(callbacks):
            pass
        callbacks.on_training_end()
        return self

    def _count(self, callbacks: BaseCallback) -> bool:
        callbacks.on_rollout_start()
        self.num_timesteps += 1
        self._update_current_progress_remaining(self.num_timesteps, self._total_timesteps)
        callbacks.update_locals(locals())
        goes_on = callbacks.on_step()
        callbacks.on_rollout_end()
        return goes_on

    def predict(
        self,
        observation: np.ndarray | dict[str, np.ndarray],
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = False,
    ) -> tuple[np.ndarray, Any]:
        """
        Plan, and act. See :meth:`sb3_hucrl.planning.MPCPolicy.predict`.

        :raises RuntimeError: if there is no dynamics model yet
        """
        if self.planner is None:
            self.planner = self._make_planner()
        return self.planner.predict(observation, state, episode_start, deterministic)

    def _make_planner(self) -> MPCPolicy:
        learned, recipe, planning = self.hucrl, self.recipe, self.planning
        if learned is None or recipe is None or planning is None:
            raise RuntimeError(
                "H-MPC has no dynamics model and settings to plan with: call learn() with a HUCRLCallback first (files "
                "of version 0.1 hold the model alone, and learn() goes on with it)"
            )
        learned.dynamics.to(self.device)
        world = recipe.world(learned, recipe.starts(learned), planning.rollouts)
        return planning.build(world, None, learned.draw_seed())
