"""The outer loop of H-UCRL (Algorithm 2), around any SB3 algorithm."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch as th
from sb3_contrib import ARS
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import CSVOutputFormat
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv

from sb3_hucrl.actors import BatchActor, one_by_one, planner_actor, policy_actor, random_actor
from sb3_hucrl.algorithms import HMPC
from sb3_hucrl.checkpoint import save_atomically
from sb3_hucrl.data import TransitionDataset, Transitions
from sb3_hucrl.dynamics import DynamicsModel, FitReport, Predictor, make_dynamics, require_known
from sb3_hucrl.exploration import ExplorationStrategy, make_strategy
from sb3_hucrl.imagination import Imagination
from sb3_hucrl.planning import HMPCSettings, MPCPolicy, PlanningRecipe, planning_settings
from sb3_hucrl.replay import MixedReplayBuffer, keep_latest, real_buffer
from sb3_hucrl.report import record_fit, record_theory
from sb3_hucrl.rollout import collect_episode, imagine_episode
from sb3_hucrl.selection import choose_policy, imagined_return
from sb3_hucrl.spaces import require_bounded_box, require_vector_observation
from sb3_hucrl.stack import find_imagination, restart_trajectories
from sb3_hucrl.starts import StartStates
from sb3_hucrl.state import HUCRLState, attach_state, get_state
from sb3_hucrl.tasks import LearnedReward, Task, check_task, resolve_task
from sb3_hucrl.uncertainty import epistemic_limit, epistemic_std

#: imagined trajectories by which a policy is judged
JUDGED = 32


class HUCRLCallback(BaseCallback):
    """
    Alternates real episodes with policy search in imagination, the search being the SB3 algorithm's own.

    At the start it runs ``initial_episodes`` random real episodes and fits the dynamics model. From then on the
    algorithm trains in imagination; after every ``imagined_steps`` of its timesteps the callback plays
    ``real_episodes`` episodes with the current policy (a′ dropped), appends them, refits, and restarts imagination.
    Policy, critic and dynamics model are warm-started. At first these episodes sample the policy, as the search does:
    its mode alone can stand still and teach the model nothing. Later ones, and always those that training ends with,
    play the mode, which is what SB3 evaluates, of the best policy so far by the return that the latest model promises;
    the search goes on from that one.

    ``num_timesteps`` counts imagined steps; real ones are logged as ``real/steps``. What was learned is kept as
    ``model.hucrl`` (:class:`sb3_hucrl.state.HUCRLState`) and travels in the model's own zip file; a loaded model goes
    on where it was.

    :param exploration: name of a strategy (a key of :data:`sb3_hucrl.exploration.STRATEGIES`), or a strategy
    :param exploration_kwargs: arguments of the named strategy, such as ``{"beta": 1.0}``
    :param dynamics: name of a dynamics model (a key of :data:`sb3_hucrl.dynamics.DYNAMICS`), or a model
    :param dynamics_kwargs: arguments of the named model
    :param task: reward, termination and state map: a task, the place to import one from (``"my_module.MyTask"``), or
        ``"learned"`` to learn reward and termination. By default the one registered for the environment's id, and
        learned where there is none
    :param task_kwargs: arguments of an imported or learned task
    :param horizon: length of an imagined trajectory; by default that of a real episode
    :param imagined_steps: timesteps of policy search between real episodes, over all imagined trajectories
    :param initial_episodes: random real episodes before the first search, at least 1
    :param real_episodes: real episodes after each search, at least 1
    :param sampling_fraction: share of the training in which real episodes sample the policy, in [0, 1]
    :param start_states: weights of the kinds of imagined start states, see :class:`sb3_hucrl.starts.StartStates`
    :param real_data_fraction: share of real transitions in each batch that an off-policy algorithm replays, in [0, 1]
    :param stale_fraction: share of the replay buffer, the latest of it, that outlives a refit; by default nothing that
        an older model imagined
    :param planner: plan the actions of real episodes online, by the planner of this name (a key of
        :data:`sb3_hucrl.planning.PLANNERS`), instead of playing the policy: H-MPC
    :param planner_kwargs: ``horizon``, ``gamma`` and ``rollouts`` of :class:`sb3_hucrl.planning.HMPCSettings`, and the
        planner's own arguments
    :param dyna_mpc: arguments of :class:`sb3_hucrl.planning.DynaMPCSettings`, to plan around the policy in the real
        episodes that play its mode
    :param uncertainty_cap: truncate imagined trajectories where the epistemic std of any state dimension exceeds this
        multiple of what 95 % of the real transitions have; by default never
    :param reward_threshold: stop training after a real episode with at least this return; by default never
    :param log_dir: folder for ``progress.csv`` with everything that is logged; rl_zoo3 runs use the run's folder
    :param checkpoint: file in which the SB3 model is saved after every real episode, so that no real step is ever lost;
        rl_zoo3 runs use ``checkpoint.zip`` in the run's folder
    :param verbose: 1 prints what is resumed
    :raises ValueError: if a number is too small or a name unknown
    """

    def __init__(
        self,
        exploration: str | ExplorationStrategy = "optimistic",
        exploration_kwargs: Mapping[str, Any] | None = None,
        dynamics: str | DynamicsModel = "ensemble",
        dynamics_kwargs: Mapping[str, Any] | None = None,
        task: Task | str | None = None,
        task_kwargs: Mapping[str, Any] | None = None,
        horizon: int | None = None,
        imagined_steps: int = 25_600,
        initial_episodes: int = 1,
        real_episodes: int = 1,
        sampling_fraction: float = 0.5,
        start_states: Mapping[str, float] | None = None,
        real_data_fraction: float = 0.0,
        stale_fraction: float = 0.0,
        planner: str | None = None,
        planner_kwargs: Mapping[str, Any] | None = None,
        dyna_mpc: Mapping[str, Any] | None = None,
        uncertainty_cap: float | None = None,
        reward_threshold: float | None = None,
        log_dir: str | None = None,
        checkpoint: str | None = None,
        verbose: int = 0,
    ) -> None:
        super().__init__(verbose)
        counts = {
            "imagined_steps": imagined_steps,
            "initial_episodes": initial_episodes,
            "real_episodes": real_episodes,
        }
        if horizon is not None:
            counts["horizon"] = horizon
        for name, value in counts.items():
            if value < 1:
                raise ValueError(f"{name} is {value}: give at least 1")
        shares = {
            "sampling_fraction": sampling_fraction,
            "real_data_fraction": real_data_fraction,
            "stale_fraction": stale_fraction,
        }
        for name, share in shares.items():
            if not 0 <= share <= 1:
                raise ValueError(f"{name} is {share}: give a share between 0 and 1")
        if isinstance(dynamics, str):
            require_known(dynamics)
        if uncertainty_cap is not None and not uncertainty_cap > 0:
            raise ValueError(f"uncertainty_cap is {uncertainty_cap}: give a positive multiple, or None for no cap")
        self.planning = planning_settings(planner, planner_kwargs, dyna_mpc)
        if isinstance(exploration, str):
            exploration = make_strategy(exploration, **(exploration_kwargs or {}))
        self.strategy: ExplorationStrategy = exploration
        self.dynamics = dynamics
        self.dynamics_kwargs = dict(dynamics_kwargs or {})
        self.task = task
        self.task_kwargs = dict(task_kwargs or {})
        self.horizon = horizon
        self.imagined_steps = imagined_steps
        self.initial_episodes = initial_episodes
        self.real_episodes = real_episodes
        self.sampling_fraction = sampling_fraction
        self.start_states = start_states
        self.real_data_fraction = real_data_fraction
        self.stale_fraction = stale_fraction
        self.uncertainty_cap = uncertainty_cap
        self.reward_threshold = reward_threshold
        self.log_dir = log_dir
        self.checkpoint = checkpoint
        self._csv: CSVOutputFormat | None = None
        self._planner: MPCPolicy | None = None
        self._searching = False
        self._solved = False
        self._search_start = 0
        self._clock = 0.0

    def _on_training_start(self) -> None:
        self._solved = False
        self._imagination_env = find_imagination(self.training_env)
        if self.training_env.num_envs < 2 and not isinstance(self.model, ARS) and self._searches:
            raise ValueError(
                f"n_envs is {self.training_env.num_envs}: imagination steps all environments as one batch and needs "
                "at least 2; make 32 or so, for example make_vec_env(..., n_envs=32)"
            )
        self._log_to_csv()
        spec = self._real_env.get_attr("spec", indices=0)[0]
        observation_dim = require_vector_observation(self._real_env.observation_space).shape[0]
        self._task = resolve_task(self.task, self.task_kwargs, spec, observation_dim)
        if isinstance(self._task, LearnedReward):
            self.logger.info(f"{type(self._task).__name__}: the dynamics model learns the reward, too")
        if spec is None or spec.max_episode_steps is None:
            raise ValueError(
                "the environment has no time limit, so a real episode may never end: make it with "
                "gymnasium.make(..., max_episode_steps=1000), or register it with max_episode_steps"
            )
        self._horizon = self.horizon or int(spec.max_episode_steps)
        box = self._action_box = require_bounded_box(self.training_env.action_space)
        hallucinated_dim = self._real_env.get_attr("hallucinated_dim", 0)[0] if self._is_hallucinated() else 0
        self._action_dim = box.shape[0] - hallucinated_dim
        check_task(self._task, observation_dim, self._action_dim)
        self._state = self._resume() or self._begin()
        attach_state(self.model, self._state)
        # Built before any real step is taken, so that what does not fit is found at once.
        self._starts = StartStates(self._state.dataset, self._task, self.start_states)
        self._imagine(self._state.dynamics)
        self._prepare_planner(self._state.dynamics)
        started = time.perf_counter()
        act = random_actor(box, self._state.generator)
        for _ in range(self._state.real_episodes, self.initial_episodes):
            self._append(collect_episode(self._real_env, act, self._task, self._action_dim))
        if self._state.fitted_steps < len(self._state.dataset):
            self._refit(time.perf_counter() - started, search_seconds=0.0)
        self._start_search()

    def _on_rollout_start(self) -> None:
        imagined_steps = self.imagined_steps if self._searches else 1
        if self.model.num_timesteps - self._search_start >= imagined_steps:
            progress = self.model.num_timesteps / self.model._total_timesteps
            self._end_search(deterministic=progress >= self.sampling_fraction)
            self._start_search()

    def _on_step(self) -> bool:
        return not self._solved

    def _on_training_end(self) -> None:
        # rl_zoo3 calls this a second time, and also after an interruption: a search cut short is not acted on.
        if not self._searching:
            return
        if self.model.num_timesteps >= self.model._total_timesteps > self._search_start:
            self._end_search(deterministic=True)
        self._searching = False
        self._imagination_env.real()

    @property
    def _real_env(self) -> VecEnv:
        return self._imagination_env.venv

    @property
    def _searches(self) -> bool:
        # H-MPC has no policy.
        return not isinstance(self.model, HMPC)

    def _is_hallucinated(self) -> bool:
        return self._real_env.has_attr("hallucinated_dim")

    def _begin(self) -> HUCRLState:
        # Without a seed of its own the model drew from torch's global generator, and so does this.
        seed = self.model.seed if self.model.seed is not None else int(th.randint(2**31, ()))
        generator = th.Generator().manual_seed(seed)
        dataset_seed = int(th.randint(2**31, (), generator=generator))
        dataset = TransitionDataset(self._task.width, self._action_dim, seed=dataset_seed)
        dynamics = self.dynamics
        if isinstance(dynamics, str):
            dynamics = make_dynamics(
                dynamics,
                self._task.state_dim,
                self._action_dim,
                self._task.angle_dims,
                generator,
                **self.dynamics_kwargs,
            )
        return HUCRLState(dataset, dynamics.to(self.model.device), generator)

    def _resume(self) -> HUCRLState | None:
        state = get_state(self.model)
        if state is None:
            return None
        found = (state.dataset.state_dim, state.dataset.action_dim)
        expected = (self._task.width, self._action_dim)
        if found != expected:
            raise ValueError(
                f"the loaded model carries transitions with (state, action) dimensions {found}, this environment has "
                f"{expected}: load a model that was trained on this environment"
            )
        if self.verbose > 0:
            print(f"Resuming with {state.real_episodes} real episodes, {len(state.dataset)} real steps")
        state.dynamics.to(self.model.device)
        return state

    def _imagine(self, model: Predictor, max_epistemic_std: th.Tensor | None = None) -> None:
        seed = self._state.draw_seed()
        self._imagination = self._imagination_env.imagine(
            model, self.strategy, self._task, self._horizon, self._starts, seed, max_epistemic_std
        )

    def _start_search(self) -> None:
        state = self._state
        limit = None
        if self.uncertainty_cap is not None:
            limit = epistemic_limit(state.dynamics, state.dataset.transitions, self.uncertainty_cap)
        num_samples = max(self.training_env.num_envs, self.planning.rollouts if self.planning else 1)
        self._search_model = self.strategy.begin_search(
            state.dynamics, num_samples, state.real_episodes, state.generator
        )
        record_theory(self.logger, state.dynamics, self.strategy)
        self._imagine(self._search_model, limit)
        self._prepare_planner(self._search_model)
        if isinstance(self.model, OffPolicyAlgorithm):
            self._renew_replay(self.model)
        restart_trajectories(self.model)
        self._search_start = self.model.num_timesteps
        self._searching = True
        self._clock = time.perf_counter()

    def _prepare_planner(self, predictor: Predictor) -> None:
        if self.planning is None:
            return
        recipe = PlanningRecipe(self.planning, self.strategy, self._task)
        self._planner = recipe.build(predictor, self._action_box, self.model, self._state.fork_seed())
        if isinstance(self.model, HMPC):
            self.model.recipe, self.model.planner = recipe, self._planner

    def _renew_replay(self, model: OffPolicyAlgorithm) -> None:
        buffer = model.replay_buffer
        assert buffer is not None  # an off-policy algorithm in training has one
        if self.real_data_fraction > 0:
            if not isinstance(buffer, MixedReplayBuffer):
                model.replay_buffer = buffer = MixedReplayBuffer(buffer, self.real_data_fraction)
            rng = np.random.default_rng(self._state.draw_seed())
            buffer.real = real_buffer(buffer.imagined, self._state.dataset, self._task, self._action_box, rng)
        # What the last model imagined may contradict the new one.
        keep_latest(buffer.imagined if isinstance(buffer, MixedReplayBuffer) else buffer, self.stale_fraction)

    def _end_search(self, deterministic: bool) -> None:
        if deterministic and self._searches:
            self._state.best, promised = choose_policy(self.model, self._state.best, self._mode_return)
            self.logger.record("imagined/mode_return", promised)
        search_seconds = time.perf_counter() - self._clock
        started = time.perf_counter()
        for _ in range(self.real_episodes):
            act = self._planned(deterministic)
            if act is None:
                act = policy_actor(self.model, deterministic)
                self._imagine_episode(act)
                act = policy_actor(self.model, deterministic)
            self._append(collect_episode(self._real_env, one_by_one(act), self._task, self._action_dim))
        self._refit(time.perf_counter() - started, search_seconds)

    def _imagine_episode(self, act: BatchActor) -> None:
        episode = imagine_episode(self._from_real_starts(1), act, self._action_dim)
        self._state.imagined_episodes.append(episode)
        # Of the whole model, also where a posterior sample was imagined, which is sure of itself.
        self.logger.record_mean("imagined/epistemic_std", float(epistemic_std(self._state.dynamics, episode).mean()))

    def _planned(self, deterministic: bool) -> BatchActor | None:
        # Dyna-MPC refines the policy's mode. An episode that samples the policy explores, and it would undo that.
        if self._planner is None or not (deterministic or isinstance(self.planning, HMPCSettings)):
            return None
        return planner_actor(self._planner)

    def _from_real_starts(self, num_envs: int) -> Imagination:
        """Trajectories of what the search imagined, from where real episodes begin."""
        starts = StartStates(self._state.dataset, self._task, {"initial": 1.0})
        return Imagination(
            self._search_model, self.strategy, self._task, starts, self._horizon, num_envs, self._action_box, seed=0
        )

    def _mode_return(self) -> float:
        return imagined_return(self._from_real_starts(JUDGED), policy_actor(self.model, deterministic=True))

    def _append(self, episode: Transitions) -> None:
        self._state.dataset.append_episode(episode)
        self._state.real_episodes += 1
        self._state.last_return = float(episode.rewards.sum(dtype=th.float64))
        if self.reward_threshold is not None and self._state.last_return >= self.reward_threshold:
            self._solved = True
        if self.checkpoint is not None:
            save_atomically(self.model, self.checkpoint)

    def _refit(self, rollout_seconds: float, search_seconds: float) -> None:
        started = time.perf_counter()
        state = self._state
        # ARS, which needs no gradients, has switched them off.
        with th.enable_grad():
            report = state.dynamics.fit(state.dataset, state.generator)
        state.fitted_steps = len(state.dataset)
        self._log(report, rollout_seconds, time.perf_counter() - started, search_seconds)

    def _log(self, report: FitReport, rollout_seconds: float, fit_seconds: float, search_seconds: float) -> None:
        record = self.logger.record
        record("real/episode", self._state.real_episodes)
        record("real/steps", len(self._state.dataset))
        record("real/return", self._state.last_return)
        if self._imagination.initial_returns:
            record("imagined/return", float(np.mean(self._imagination.initial_returns[-self.training_env.num_envs :])))
        record_fit(self.logger, report)
        record("time/rollout_seconds", rollout_seconds)
        record("time/fit_seconds", fit_seconds)
        record("time/search_seconds", search_seconds)
        record("time/total_timesteps", self.model.num_timesteps, exclude="tensorboard")
        self.logger.dump(self.model.num_timesteps)

    def _log_to_csv(self) -> None:
        if self.log_dir is None:
            return
        if self._csv is None:
            Path(self.log_dir).mkdir(parents=True, exist_ok=True)
            self._csv = CSVOutputFormat(str(Path(self.log_dir) / "progress.csv"))
        if self._csv not in self.logger.output_formats:
            self.logger.output_formats.append(self._csv)
