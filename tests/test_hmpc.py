"""H-MPC as an algorithm, as the acting policy of another algorithm, and with every strategy and model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecNormalize

from helpers import ENV_ID, imagination_env, small_callback, small_sac, state_of
from sb3_hucrl import HUCRLCallback, ImaginationVecEnv
from sb3_hucrl.algorithms import HMPC
from sb3_hucrl.planning import PLANNERS

SMALL: dict[str, dict[str, Any]] = {
    "random_shooting": {"num_particles": 8},
    "cem": {"num_particles": 8, "num_iterations": 2, "num_elites": 3},
    "icem": {"num_particles": 8, "num_iterations": 2, "num_elites": 3},
    "mppi": {"num_particles": 8, "num_iterations": 2},
    "ilqr": {"num_particles": 4, "num_iterations": 2},
}
STRATEGIES: dict[str, dict[str, Any]] = {
    "optimistic": {"exploration": "optimistic"},
    "greedy": {"exploration": "greedy"},
    "ts1": {"exploration": "greedy", "exploration_kwargs": {"propagation": "ts1"}},
    "tsinf": {"exploration": "greedy", "exploration_kwargs": {"propagation": "tsinf"}},
    "thompson": {"exploration": "thompson"},
    "bonus": {"exploration": "bonus"},
}
MODELS: dict[str, dict[str, Any]] = {
    "ensemble": {"num_members": 2, "gradient_steps": 10, "net_arch": [8]},
    "gp": {"max_points": 40},
}


def hmpc(**env_kwargs: Any) -> HMPC:
    return HMPC("NoPolicy", imagination_env(1, max_episode_steps=20, **env_kwargs), seed=0, device="cpu")


def planning_callback(planner: str, horizon: int = 3, **settings: Any) -> HUCRLCallback:
    return small_callback(planner=planner, planner_kwargs={"horizon": horizon, **SMALL[planner]}, **settings)


@pytest.mark.parametrize("dynamics", MODELS)
@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("planner", PLANNERS)
def test_every_planner_plans_with_every_strategy_and_model(planner: str, strategy: str, dynamics: str) -> None:
    env = imagination_env(1, max_episode_steps=8, hallucinate=strategy == "optimistic")
    model = HMPC("NoPolicy", env, seed=0, device="cpu")
    chosen = {**STRATEGIES[strategy], "dynamics": dynamics, "dynamics_kwargs": MODELS[dynamics]}
    callback = planning_callback(planner, initial_episodes=3, **chosen)
    model.learn(1, callback)
    assert state_of(model).real_episodes == 4
    actions = state_of(model).dataset.transitions.actions[-8:]
    assert actions.abs().max() <= 1
    # So few steps ahead nothing is to be had but a penalty, and iLQR knows.
    assert (actions.std() > 0) == (planner != "ilqr" or strategy == "bonus")


def test_a_saved_algorithm_plans_and_goes_on(tmp_path: Path) -> None:
    model = hmpc()
    model.learn(2, planning_callback("icem"))
    model.save(tmp_path / "model")
    env = imagination_env(1, max_episode_steps=20)
    loaded = HMPC.load(tmp_path / "model", env=env, device="cpu")
    returned, lengths = evaluate_policy(loaded, env.venv, 2, return_episode_rewards=True, warn=False)
    assert lengths == [20, 20]
    assert np.isfinite(returned).all()
    loaded.learn(1, planning_callback("icem"), reset_num_timesteps=False)
    assert state_of(loaded).real_episodes == 4


def test_the_same_seed_plans_the_same_episodes() -> None:
    first, second = hmpc(), hmpc()
    for model in (first, second):
        model.learn(1, planning_callback("cem"))
    one, other = (state_of(model).dataset.transitions.states for model in (first, second))
    assert (one == other).all()


def test_another_algorithm_searches_while_a_planner_acts() -> None:
    model = small_sac(imagination_env(max_episode_steps=20))
    model.learn(160, planning_callback("mppi"))
    assert state_of(model).real_episodes == 3
    assert not state_of(model).imagined_episodes
    assert model._n_updates > 0


def test_what_cannot_be_planned_says_what_to_do() -> None:
    with pytest.raises(RuntimeError, match="call learn"):
        hmpc().predict(np.zeros(3, np.float32))
    env = imagination_env(1)
    with pytest.raises(ValueError, match="planner='icem'"):
        HMPC("NoPolicy", env).learn(1, small_callback())
    assert env.get_attr("total_steps") == [0]
    with pytest.raises(ValueError, match="planner='icem'"):
        hmpc().learn(1)
    with pytest.raises(ValueError, match="no VecNormalize"):
        HMPC("NoPolicy", VecNormalize(ImaginationVecEnv(make_vec_env(ENV_ID, 1))))
