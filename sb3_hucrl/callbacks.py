"""The outer loop of H-UCRL (Algorithm 2) as a callback of any SB3 algorithm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback

from sb3_hucrl.checks import Location, Natural, validated
from sb3_hucrl.dynamics import DynamicsModel
from sb3_hucrl.exploration import ExplorationStrategy, choose_strategy
from sb3_hucrl.loop import ModelSettings, RealSettings, Report, SearchSettings, Settings
from sb3_hucrl.planning import planning_settings
from sb3_hucrl.products import FastProducts
from sb3_hucrl.sb3 import Checkpoint, LoggedSource, TrainingLog, find_imagination, make_loop, make_search, require_place
from sb3_hucrl.tasks import Task


@validated
class HUCRLCallback(BaseCallback):
    """
    Alternates real episodes with policy search in imagination, by the SB3 algorithm that it is given to. Random ones,
    or logged ``transitions``, come first, then in turn a fit of the dynamics model, a search, and ``real_episodes``
    without a′. What is learned is ``model.hucrl`` (:class:`sb3_hucrl.HUCRLState`), in zip files too.

    :param exploration: a strategy, or the name of one (:data:`sb3_hucrl.exploration.STRATEGIES`)
    :param exploration_kwargs: arguments of the named strategy, such as ``{"beta": 1.0}``
    :param dynamics: a dynamics model, or the name of one (:data:`sb3_hucrl.dynamics.DYNAMICS`)
    :param dynamics_kwargs: arguments of the named model
    :param task: a task, the place to import one from, or ``"learned"``; by default that of the id, or learned
    :param task_kwargs: arguments of an imported or learned task
    :param horizon: length of an imagined trajectory, or ``[first, last, begin, end]``; default: chosen after each refit
    :param imagined_steps: timesteps of each policy search; by default 64 for each new real step, 128 for few of them
    :param transitions: logged data to begin with: a file, Minari id, replay buffer or dataset, see docs/logged_data.md
    :param initial_episodes: random real episodes before the first search; by default 1, or none with ``transitions``
    :param initial_steps: least number of steps in them; by default 200, or a full-length episode if that has fewer
    :param seek_reward: ``[hold, until]``: where random episodes meet no reward, their actions are held, and they go on
    :param real_episodes: real episodes after each search, at least 1
    :param real_steps: least number of steps in them; by default as for ``initial_steps``
    :param real_envs: number of environments that play real episodes at once, a round; ``real/return`` is its mean
    :param max_real_steps: stop training after the first real episode that reaches so many real steps; by default never
    :param whole_episodes: False: let real episodes wait for refits and searches, after exactly ``real_steps``
    :param early_time_limit: ``[steps, until]``: before ``until`` real steps, episodes end after ``steps``; or never
    :param sampling_fraction: of the training, in which real episodes sample the policy; later the best mode plays
    :param start_states: weights of the kinds of imagined start states, see :class:`sb3_hucrl.StartStates`
    :param real_data_fraction: fraction of real transitions in each batch of an off-policy algorithm, in [0, 1]
    :param stale_fraction: fraction of the replay buffer kept after a refit, newest first, in [0, 1]
    :param planner: H-MPC: name of a planner (:data:`sb3_hucrl.planning.PLANNERS`) that acts in real episodes
    :param planner_kwargs: arguments of :class:`sb3_hucrl.planning.HMPCSettings` and of the planner
    :param dyna_mpc: arguments of :class:`sb3_hucrl.planning.DynaMPCSettings`, to plan around the policy
    :param uncertainty_cap: truncate trajectories where the epistemic std is this multiple of the usual one; None: never
    :param standardise: whether the policy's networks see standardised observations, where they do not already
    :param reward_threshold: stop training after a round of real episodes with at least this mean return; default: never
    :param log_dir: folder for ``progress.csv`` with everything that is logged; rl_zoo3 gives the run's folder
    :param checkpoint: zip file to save the model in after every real episode and refit; in rl_zoo3 ``checkpoint.zip``
    :param verbose: 1 prints a line for each real episode, 2 SB3's tables, 0 nothing; by default as the algorithm's
    :raises ValueError: if a number is out of its range or a name unknown
    """

    def __init__(
        self,
        exploration: str | ExplorationStrategy = "optimistic",
        *,
        exploration_kwargs: Mapping[str, Any] | None = None,
        dynamics: str | DynamicsModel = "ensemble",
        dynamics_kwargs: Mapping[str, Any] | None = None,
        task: Task | str | None = None,
        task_kwargs: Mapping[str, Any] | None = None,
        horizon: int | Sequence[int] | None = None,
        imagined_steps: int | None = None,
        transitions: LoggedSource | None = None,
        initial_episodes: int | None = None,
        initial_steps: int | None = None,
        seek_reward: Sequence[int] | None = None,
        real_episodes: int = 1,
        real_steps: int | None = None,
        real_envs: int = 1,
        max_real_steps: int | None = None,
        whole_episodes: bool = True,
        early_time_limit: Sequence[int] | None = None,
        sampling_fraction: float = 0.5,
        start_states: Mapping[str, float] | None = None,
        real_data_fraction: float = 0.0,
        stale_fraction: float = 0.0,
        planner: str | None = None,
        planner_kwargs: Mapping[str, Any] | None = None,
        dyna_mpc: Mapping[str, Any] | None = None,
        uncertainty_cap: float | None = None,
        standardise: bool = True,
        reward_threshold: float | None = None,
        log_dir: Location | None = None,
        checkpoint: Location | None = None,
        verbose: Natural | None = None,
    ) -> None:
        super().__init__(verbose or 0)
        played = initial_episodes, initial_steps, seek_reward, real_episodes, real_steps, real_envs, max_real_steps
        searched = choose_strategy(exploration, exploration_kwargs), imagined_steps, horizon, start_states
        real = RealSettings(*played, sampling_fraction, reward_threshold, whole_episodes, early_time_limit)
        search = SearchSettings(*searched, real_data_fraction, stale_fraction, uncertainty_cap, standardise)
        model = ModelSettings(dynamics, dynamics_kwargs, task, task_kwargs)
        self.settings = Settings(real, search, model, planning_settings(planner, planner_kwargs, dyna_mpc))
        self.transitions, self.log_dir, self.checkpoint = transitions, log_dir, checkpoint
        self.given_verbose, self._log, self._searching = verbose, TrainingLog(), False

    def _on_training_start(self) -> None:
        require_place(self, HUCRLCallback)
        model, self._env = self.model, find_imagination(self.training_env)
        FastProducts(model.device)
        hooks = self._save, self._on_refit
        self._loop = make_loop(model, self._env, self.settings, self.transitions, *hooks, self.given_verbose)
        self._file, self._search = Checkpoint(model, self.checkpoint), make_search(model, self._env, self._loop)
        self._total_timesteps = self._search.total_timesteps(self.locals)
        self._log.begin(model, self._loop, self._search, self.log_dir, self.given_verbose, self)
        self._loop.begin()
        self._start_search()

    def _on_rollout_start(self) -> None:
        if self._search.is_over:
            self._end_search()
            self._start_search()

    def _on_step(self) -> bool:
        return not self._loop.finished

    def _on_training_end(self) -> None:
        # rl_zoo3 calls this a second time, and also after an interruption: a search cut short is not played.
        if self._searching and self.model.num_timesteps >= self._total_timesteps and self._search.steps > 0:
            self._end_search()
        if self._searching:
            self._searching = False
            self._env.real()
            self._file.end()
        self._log.end()
        FastProducts.end()

    def _start_search(self) -> None:
        ends = (self.model.num_timesteps + self._loop.imagined_steps) / self._total_timesteps
        self._search.restart(self._loop.begin_search(self._env.num_envs, progress=ends))
        self._searching = True

    def _end_search(self) -> None:
        self._loop.end_search(self._search, progress=self.model.num_timesteps / self._total_timesteps)

    def _on_refit(self, report: Report) -> None:
        self._log.record(report)
        self._save()

    def _save(self) -> None:
        self._file.save()
