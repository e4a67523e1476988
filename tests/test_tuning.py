"""``rl_zoo3 train -optimize``: tunes the callback's settings too, and evaluates on the real environment."""

from __future__ import annotations

import copy
import dataclasses
import os
from pathlib import Path
from typing import Any

import gymnasium as gym
import optuna
import pytest
import yaml
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import TrialState
from rl_zoo3.hyperparams_opt import HYPERPARAMS_CONVERTER, HYPERPARAMS_SAMPLER
from rl_zoo3.utils import ALGOS

from helpers import ENV_ID
from sb3_hucrl import HUCRLCallback
from sb3_hucrl.zoo.callback_entry import CallbackEntry, find_entry
from sb3_hucrl.zoo.settings import changed
from sb3_hucrl.zoo.tuning import suggest
from test_zoo import OWN_ENVIRONMENT, SHORT, TRAIN
from zoo_command import ZOO, run

EXPLODING = '''
import itertools
from sb3_hucrl.tasks import PendulumTask

instances = itertools.count()

class ExplodingTask(PendulumTask):
    """The first one built has an infinite reward."""

    def __init__(self):
        super().__init__()
        self.explodes = next(instances) == 0

    def reward(self, state, action, next_state):
        reward = super().reward(state, action, next_state)
        return reward + float("inf") if self.explodes else reward
'''


def drawn(settings: dict[str, Any], env_id: str = ENV_ID, searches: bool = True) -> dict[str, Any]:
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=0))
    trial = study.ask()
    suggest(trial, settings, gym.spec(env_id), 3, 10_000, searches)
    return trial.params


def tuned_by(settings: dict[str, Any], params: dict[str, Any]) -> dict[str, Any]:
    return dict(changed(CallbackEntry("sb3_hucrl.HUCRLCallback", HUCRLCallback, settings), params).settings)


def test_where_actions_are_planned_the_planners_horizon_is_drawn() -> None:
    settings = {"planner": "icem", "planner_kwargs": {"num_particles": 64}}
    params = drawn(settings, searches=False)
    assert set(params) == {
        f"hucrl_{name}" for name in ("beta", "planner_horizon", "num_members", "dynamics_learning_rate")
    }
    tuned = tuned_by(settings, params)
    assert tuned["planner_kwargs"] == {"num_particles": 64, "horizon": params["hucrl_planner_horizon"]}


@pytest.mark.parametrize("algo", ["hmpc", "mpo", "hmpo", "hbptt", "hmve", "hsvg"])
def test_what_is_drawn_for_our_own_algorithms_are_their_arguments(algo: str) -> None:
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=0))
    additional = {"using_her_replay_buffer": False, "her_kwargs": {}}
    trial = study.ask()
    sampled = HYPERPARAMS_SAMPLER[algo](trial, 3, 32, additional)
    policy = "NoPolicy" if algo == "hmpc" else "MlpPolicy"
    model = ALGOS[algo](policy, "Pendulum-v1", device="cpu", **copy.deepcopy(sampled))
    chosen = sampled.keys() - {"train_freq", "policy_kwargs"}
    assert all(getattr(model, name) == sampled[name] for name in chosen)
    assert HYPERPARAMS_CONVERTER[algo](trial.params) == sampled


def test_a_trial_of_hmpc_keeps_the_settings_of_the_callback() -> None:
    assert HYPERPARAMS_CONVERTER["hmpc"]({"hucrl_beta": 0.5}) == {"hucrl_beta": 0.5}


def test_our_settings_are_drawn_and_put_where_they_belong() -> None:
    settings = {"exploration_kwargs": {"uncertainty": "predictive"}, "dynamics_kwargs": {"net_arch": [8]}, "horizon": 3}
    params = drawn(settings)
    tuned = tuned_by(settings, params)
    assert tuned["exploration_kwargs"] == {"uncertainty": "predictive", "beta": params["hucrl_beta"]}
    assert tuned["dynamics_kwargs"]["net_arch"] == [8]
    assert tuned["dynamics_kwargs"]["num_members"] == params["hucrl_num_members"]
    assert tuned["dynamics_kwargs"]["learning_rate"] == params["hucrl_dynamics_learning_rate"]
    assert 10 <= tuned["horizon"] == params["hucrl_horizon"] <= 400
    assert 500 <= tuned["imagined_steps"] <= 5_000
    assert set(tuned["start_states"]) == {"initial", "visited", "inflated", "exploratory"}
    assert settings["horizon"] == 3


def test_what_a_setting_does_not_have_is_not_tuned() -> None:
    params = drawn({"exploration": "greedy", "dynamics": "sparse_gp"}, "HUCRL-Reacher-v0")
    assert set(params) == {
        *("hucrl_horizon", "hucrl_imagined_steps"),
        *("hucrl_start_initial", "hucrl_start_visited", "hucrl_start_inflated"),
    }


def test_an_own_task_may_have_no_exploratory_states() -> None:
    assert "hucrl_start_exploratory" in drawn({})
    assert "hucrl_start_exploratory" not in drawn({"task": "my_module.MyTask"})


def test_an_environment_without_a_time_limit_is_refused() -> None:
    spec = dataclasses.replace(gym.spec("Pendulum-v1"), max_episode_steps=None)
    with pytest.raises(ValueError, match=r"Pendulum-v1 has no time limit.*--env-kwargs max_episode_steps:1000"):
        suggest(optuna.create_study().ask(), {}, spec, 3, 10_000)


@pytest.mark.slow
def test_a_study_of_an_own_environment_tunes_the_callback_from_where_the_command_line_put_it(tmp_path: Path) -> None:
    (tmp_path / "my.yml").write_text(OWN_ENVIRONMENT)
    options = ["-n", "640", "--storage", "study.log", "--study-name", "own", "-conf", "my.yml"]
    greedy = ["-params", "hucrl_exploration:'greedy'", "env_wrapper:None"]
    own = ["train", "--algo", "sac", "--env", "Pendulum-v1", *options, *greedy]
    run(ZOO, *own, "-optimize", "--n-trials", "1", "--no-optim-plots", "--eval-episodes", "1", cwd=tmp_path)
    storage = JournalStorage(JournalFileBackend(str(tmp_path / "study.log")))
    [trial] = optuna.load_study(study_name="own", storage=storage).trials
    assert trial.state == TrialState.COMPLETE
    assert trial.params["hucrl_horizon"] <= 200
    # The command line asked for a strategy without one.
    assert "hucrl_beta" not in trial.params
    assert trial.user_attrs["real_steps"] >= 2 * 200


@pytest.mark.slow
def test_a_study_prunes_divergence_goes_on_and_trains_what_it_found(tmp_path: Path) -> None:
    (tmp_path / "exploding.py").write_text(EXPLODING)
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    study_options = ["-n", "640", "--storage", "study.log", "--study-name", "pendulum"]
    optimize = ["-optimize", "--n-jobs", "2", "--no-optim-plots", "--n-startup-trials", "9", "--eval-episodes", "1"]
    exploding = ["-params", "n_envs:4", *SHORT, "hucrl_task:'exploding.ExplodingTask'"]
    for trials in ("3", "1"):
        command = [ZOO, *TRAIN, *study_options, *optimize, "--n-trials", trials, *exploding]
        run(*command, cwd=tmp_path, PYTHONPATH=path)
    storage = JournalStorage(JournalFileBackend(str(tmp_path / "study.log")))
    study = optuna.load_study(study_name="pendulum", storage=storage)
    states = [trial.state for trial in study.trials]
    # Each process has its own first task, which explodes.
    assert states.count(TrialState.PRUNED) == 2
    assert states.count(TrialState.COMPLETE) == 2
    finished = [trial for trial in study.trials if trial.state == TrialState.COMPLETE]
    for trial in finished:
        # A random episode, and at least one search; a search is rounded up to whole rollouts.
        most = 1 + -(-640 // trial.params["hucrl_imagined_steps"])
        assert trial.user_attrs["real_steps"] in range(2 * 400, most * 400 + 1, 400)
    number = finished[-1].number
    train_it = ["--trial-id", str(number), "--eval-freq", "-1", "-params", "n_envs:4", SHORT[-1]]
    run(ZOO, *TRAIN, *study_options, *train_it, cwd=tmp_path)
    [config] = tmp_path.glob("logs/sac/*/*/config.yml")
    found = yaml.load(config.read_text(), Loader=yaml.UnsafeLoader)
    assert found["tau"] == finished[-1].params["tau"]
    assert not [name for name in found if name.startswith("hucrl_")]
    entry = find_entry(found["callback"])
    assert entry is not None
    assert entry.settings["imagined_steps"] == finished[-1].params["hucrl_imagined_steps"]
