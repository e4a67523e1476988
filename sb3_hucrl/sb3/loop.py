"""The loop around an SB3 algorithm in training."""

from __future__ import annotations

import warnings
from collections.abc import Callable

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv

from sb3_hucrl.loop import HUCRLState, Loop, Report, Settings
from sb3_hucrl.sb3.curve import carried_lines, monitor_recorder, plain
from sb3_hucrl.sb3.logged import LoggedSource, read_logged
from sb3_hucrl.sb3.normalization import carry_normalization
from sb3_hucrl.sb3.quiet import choose_verbosity
from sb3_hucrl.sb3.stack import read_problem, read_spec, real_systems
from sb3_hucrl.sb3.state import attach_state, get_state
from sb3_hucrl.tasks import LearnedReward
from sb3_hucrl.wrappers import ImaginationVecEnv


def make_loop(
    model: BaseAlgorithm,
    env: ImaginationVecEnv,
    settings: Settings,
    logged: LoggedSource | None,
    on_episode: Callable[[], None],
    on_refit: Callable[[Report], None],
    verbose: int | None,
    told: bool = False,
) -> Loop:
    """
    A loop that goes on with what the algorithm carries, and otherwise begins with what it then carries.

    :param model: in training
    :param env: the ImaginationVecEnv that it trains on
    :param settings: of the loop
    :param logged: transitions to begin with; not read where the algorithm carries some
    :param on_episode: called after each real episode, or each round of those played at once
    :param on_refit: called with a report after each refit
    :param verbose: 1 prints what is resumed; None as :func:`sb3_hucrl.sb3.quiet.choose_verbosity` says
    :param told: whether real episodes are played elsewhere, and told
    :raises ValueError: if environment, settings and what the algorithm carries do not fit together
    """
    problem = read_problem(env.venv, settings.model)
    if isinstance(problem.task, LearnedReward):
        model.logger.info(f"{type(problem.task).__name__}: the dynamics model learns the reward, too")
    if (early := settings.real.early_time_limit) is not None:
        model.logger.info(f"real episodes end after {early[0]:,} steps until {early[1]:,} real steps: early_time_limit")
    if (seeking := settings.real.seek_reward) is not None:
        least = f"where random actions meet no reward, they are held, and go on until {seeking[1]:,} real steps"
        model.logger.info(f"{least}: seek_reward")
    carried = get_state(model)
    lines = carried_lines(model)
    record = monitor_recorder(lines)
    systems = None if told else real_systems(env.venv, record)

    def record_missing() -> None:
        for episode in loop.state.dataset.episodes[len(lines["monitor"]) :]:
            record({"r": round(float(episode.rewards.double().sum()), 6), "l": len(episode)})

    def on_played() -> None:
        if told:
            record_missing()
        # From here on the search is over, even if the training ends before the next one begins.
        loop.state.search_start = model.num_timesteps
        on_episode()

    loop = Loop(settings, problem, systems, carried, model.seed, model.device, on_played, on_refit)
    # The environment of a training that ended within an episode is gone, and no Monitor saw the end.
    loop.state.dataset.end_episode()
    record_missing()
    if logged is not None and loop.state.dataset.logged_steps == 0:
        loop.add_logged(read_logged(logged, problem.task))
    carry_normalization(model)
    _note_environment(loop.state, env.venv)
    # A search that was interrupted goes on, unless timesteps are counted from 0 again.
    begun = loop.state.search_start
    loop.state.search_start = model.num_timesteps if begun is None else min(begun, model.num_timesteps)
    if carried is None:
        attach_state(model, loop.state)
        return loop
    if systems is not None:
        # SB3's load gives them the seed of the first time, and so the start states and goals of the first episodes.
        env.venv.seed(carried.draw_seed())
        env.venv.reset()
    if choose_verbosity(model, verbose) > 0:
        kept = f"{carried.real_episodes} real episodes, {carried.real_steps} real steps"
        if carried.dataset.logged_steps > 0:
            kept += f", {carried.dataset.logged_steps} logged steps"
        print(f"Resuming with {kept}; what follows differs from a run that was not interrupted")
    return loop


def _note_environment(state: HUCRLState, venv: VecEnv) -> None:
    """Warn of another environment than that of the transitions so far."""
    spec = read_spec(venv)
    if spec is None:
        return
    now = {"id": spec.id, "max_episode_steps": spec.max_episode_steps, **plain(spec.kwargs)}
    now.pop("render_mode", None)
    if state.environment not in (None, now):
        warnings.warn(
            f"the loaded model has learned from {state.environment}, and goes on in {now}: if it is not meant to, give "
            "the environment the same arguments (rl_zoo3: --env-kwargs)",
            stacklevel=2,
        )
    state.environment = now
