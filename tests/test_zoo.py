"""The rl_zoo3 plug-in, used from the command line."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest
import yaml
from stable_baselines3 import SAC
from stable_baselines3.common.monitor import load_results

from helpers import ENV_ID, EPISODE_STEPS
from sb3_hucrl.zoo.runs import ZooRun
from zoo_command import ZOO, run, run_forked

pytestmark = pytest.mark.slow

TRAIN = ["train", "--algo", "sac", "--env", ENV_ID]
SHORT = ["hucrl_horizon:20", "hucrl_imagined_steps:320", "hucrl_dynamics__gradient_steps:20"]
#: of ours and of gymnasium's
BRIEF = ["--env-kwargs", f"max_episode_steps:{EPISODE_STEPS}"]
SMALL = [
    *("-n", "640", "--eval-freq", "320", "--save-freq", "320", "--seed", "3", "--eval-episodes", "2"),
    *BRIEF,
    *("-params", "gradient_steps:1", "n_envs:4", *SHORT),
]
#: how the line of one of the first real episodes begins
LINE = r"^ {6}\d "
#: what users write for an environment that is not of this package
OWN_ENVIRONMENT = """
Pendulum-v1:
  n_envs: 4
  n_timesteps: 1000000
  policy: MlpPolicy
  env_wrapper: sb3_hucrl.HallucinationWrapper
  vec_env_wrapper: sb3_hucrl.ImaginationVecEnv
  callback:
    sb3_hucrl.HUCRLCallback: {horizon: 20, imagined_steps: 320, dynamics_kwargs: {gradient_steps: 20}}
"""
#: a package of the user's, which knows nothing of this one
OWN_PACKAGE = """
import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import register

class Slide(gym.Env):
    observation_space = gym.spaces.Box(-10, 10, (2,), np.float32)
    action_space = gym.spaces.Box(-1, 1, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.state = self.np_random.uniform(-1, 1, 2).astype(np.float32)
        return self.state, {}

    def step(self, action):
        assert action.shape == (1,)
        place, speed = self.state
        self.state = np.clip([place + 0.1 * speed, speed + action[0]], -10, 10).astype(np.float32)
        return self.state, -float(abs(place)), False, False, {}

register("Slide-v0", entry_point="my_package:Slide", max_episode_steps=50)
"""


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which a short training has left its logs."""
    folder = tmp_path_factory.mktemp("zoo")
    output = run(ZOO, *TRAIN, *SMALL, "-P", cwd=folder)
    assert "zoo_hyperparams" in output
    (folder / "printed.txt").write_text(output)
    return folder


def run_folder(folder: Path, number: int = 1) -> Path:
    return folder / "logs" / "sac" / f"{ENV_ID}_{number}"


def test_training_leaves_what_zoo_users_expect(trained: Path) -> None:
    folder = run_folder(trained)
    names = {path.name for path in folder.iterdir()}
    assert {f"{ENV_ID}.zip", "best_model.zip", "evaluations.npz", "progress.csv", "rl_model_640_steps.zip"} <= names
    assert load_results(str(folder)).l.tolist() == [EPISODE_STEPS] * 3
    progress = pd.read_csv(folder / "progress.csv")
    assert progress["real/episode"].dropna().tolist() == [1, 2, 3]


def test_our_algorithms_train_on_other_environments_without_any_flag(tmp_path: Path) -> None:
    mpo = ["--algo", "mpo", "--env", "Pendulum-v1", "-n", "200", "--eval-freq", "-1"]
    output = run_forked(ZOO, "train", *mpo, cwd=tmp_path)
    assert "zoo_hyperparams" in output
    assert (tmp_path / "logs" / "mpo" / "Pendulum-v1_1" / "Pendulum-v1.zip").exists()


def test_hmpc_trains_and_enjoys_without_a_policy(tmp_path: Path) -> None:
    planner = ["hucrl_planner:'icem'", "hucrl_planner_kwargs:{'num_particles': 4, 'num_elites': 2}"]
    params = [*planner, "hucrl_planner__num_iterations:1", "hucrl_planner__horizon:2", *SHORT]
    hmpc = ["--algo", "hmpc", "--env", ENV_ID]
    few = ["-n", "1", "--eval-freq", "-1", "--seed", "3", *BRIEF, "-params", *params]
    run_forked(ZOO, "train", *hmpc, *few, cwd=tmp_path)
    folder = tmp_path / "logs" / "hmpc" / f"{ENV_ID}_1"
    assert load_results(str(folder)).l.tolist() == [EPISODE_STEPS] * 2
    assert "Episode Reward" in run_forked(ZOO, "enjoy", *hmpc, "--no-render", "-f", "logs", "-n", "80", cwd=tmp_path)


def test_any_environment_of_gymnasium_trains_enjoys_and_goes_on(tmp_path: Path) -> None:
    hopper = ["--algo", "sac", "--env", "HUCRL-Hopper-v5"]
    output = run_forked(ZOO, "train", *hopper, *SMALL, cwd=tmp_path)
    assert "Using 'default' hyperparameters" in output
    folder = tmp_path / "logs" / "sac" / "HUCRL-Hopper-v5_1"
    # Whole episodes are played until they have as many steps together: the hopper falls soon.
    assert load_results(str(folder)).l.sum() >= 3 * EPISODE_STEPS
    assert ZooRun(folder).world().horizon == 20
    assert "Episode Reward" in run_forked(ZOO, "enjoy", *hopper, "--no-render", "-f", "logs", cwd=tmp_path)
    run_forked(ZOO, "train", *hopper, *SMALL, "-i", str(folder / "checkpoint.zip"), cwd=tmp_path)
    assert (folder.parent / "HUCRL-Hopper-v5_2" / "HUCRL-Hopper-v5.zip").exists()


def test_real_episodes_are_played_in_several_processes_at_once(tmp_path: Path) -> None:
    params = ["gradient_steps:1", "n_envs:3", *SHORT, "hucrl_real_envs:2"]
    once = ["-n", "320", "--eval-freq", "-1", *BRIEF, "-params", *params]
    run_forked(ZOO, *TRAIN, "--vec-env", "subproc", *once, cwd=tmp_path)
    monitored = [pd.read_csv(run_folder(tmp_path) / f"{number}.monitor.csv", skiprows=1) for number in range(3)]
    assert [each.l.tolist() for each in monitored] == [[EPISODE_STEPS] * 2, [EPISODE_STEPS] * 2, []]
    # A single environment is enough to look at the run.
    assert ZooRun(run_folder(tmp_path)).world().horizon == 20


@pytest.mark.parametrize("vec_env", ["dummy", "subproc"])
def test_any_environment_of_a_user_s_package_trains(tmp_path: Path, vec_env: str) -> None:
    (tmp_path / "my_package.py").write_text(OWN_PACKAGE)
    path = os.pathsep.join(filter(None, [str(tmp_path), os.environ.get("PYTHONPATH")]))
    command = [ZOO, "train", "--algo", "sac", "--env", "HUCRL-Slide-v0", "--gym-packages", "my_package"]
    few = ["-n", "640", "--eval-freq", "-1", "-params", "gradient_steps:1", "n_envs:4", *SHORT]
    run(*command, "--vec-env", vec_env, *few, cwd=tmp_path, PYTHONPATH=path)
    assert load_results(str(tmp_path / "logs" / "sac" / "HUCRL-Slide-v0_1")).l.tolist() == [50, 50, 50]


def test_an_environment_without_continuous_actions_ends_the_command_with_one_line(tmp_path: Path) -> None:
    command = [ZOO, "train", "--algo", "sac", "--env", "HUCRL-CartPole-v1", "--vec-env", "subproc"]
    with pytest.raises(AssertionError, match="there is no HUCRL-CartPole-v1: the action space is Discrete") as error:
        run_forked(*command, cwd=tmp_path)
    assert "Traceback" not in str(error.value)
    assert not (tmp_path / "logs").exists()


def test_an_environment_that_its_process_cannot_make_says_why(tmp_path: Path) -> None:
    command = [ZOO, *TRAIN, "--vec-env", "subproc", "--env-kwargs", "action_penalty:-1", "-params", "n_envs:2"]
    with pytest.raises(AssertionError, match="HUCRL-Pendulum-v0 cannot be made: action_penalty is -1: give a finite"):
        run(*command, cwd=tmp_path)


def test_our_algorithms_name_the_id_that_they_have_hyperparameters_for(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="train it on HUCRL-Hopper-v5"):
        run_forked(ZOO, "train", "--algo", "mpo", "--env", "Hopper-v5", cwd=tmp_path)


def test_the_run_keeps_the_settings_in_the_callback_s_entry(trained: Path) -> None:
    config = yaml.load((run_folder(trained) / ENV_ID / "config.yml").read_text(), Loader=yaml.UnsafeLoader)
    assert not [name for name in config if name.startswith("hucrl_")]
    settings = {"horizon": 20, "imagined_steps": 320, "dynamics_kwargs": {"gradient_steps": 20}}
    assert config["callback"] == [{"sb3_hucrl.HUCRLCallback": settings}]
    world = ZooRun(run_folder(trained)).world()
    assert world.horizon == 20
    assert world.limits.low is not None


def test_an_unknown_setting_ends_the_command(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="did you mean hucrl_horizon"):
        run_forked(ZOO, *TRAIN, "-params", "hucrl_horizn:20", cwd=tmp_path)


def test_an_own_environment_trains_quietly_and_ends_politely(tmp_path: Path) -> None:
    (tmp_path / "my.yml").write_text(OWN_ENVIRONMENT)
    command = [ZOO, "train", "--algo", "sac", "--env", "Pendulum-v1", "-conf", "my.yml", "--eval-freq", "-1"]
    folder, printed, deadline = tmp_path / "logs/sac/Pendulum-v1_1", tmp_path / "output.txt", time.monotonic() + 120
    with printed.open("w") as output:
        process = subprocess.Popen(command, cwd=tmp_path, stdout=output, stderr=subprocess.STDOUT)
    try:
        while len(re.findall(LINE, printed.read_text(), re.MULTILINE)) < 3:
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.05)
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=120) == 0
    finally:
        process.kill()
    assert (folder / "Pendulum-v1.zip").exists()
    # SB3 would write a row for every fourth imagined trajectory.
    progress = pd.read_csv(folder / "progress.csv")
    assert progress["real/episode"].notna().all()


def test_writes_one_row_for_each_real_episode_and_evaluation(trained: Path) -> None:
    rows = pd.read_csv(run_folder(trained) / "progress.csv")
    assert len(rows) == 3 + 2


def test_enjoy_plays_the_policy_on_the_real_pendulum(trained: Path) -> None:
    output = run_forked(ZOO, "enjoy", *TRAIN[1:], "--no-render", "-f", "logs", cwd=trained)
    [first, *_] = re.findall(r"Episode Reward: (-?[\d.]+)", output)
    assert float(first) == pytest.approx(load_results(str(run_folder(trained))).r.iloc[-1], abs=0.01)


def test_enjoy_renders(trained: Path) -> None:
    run_forked(ZOO, "enjoy", *TRAIN[1:], "-f", "logs", "-n", "3", cwd=trained)


def test_plots_draw_our_runs(trained: Path) -> None:
    run_forked(ZOO, "plot_train", "-a", "sac", "-e", ENV_ID, "-f", "logs", "-w", "1", cwd=trained)
    output = run_forked(ZOO, "all_plots", "-a", "sac", "-e", ENV_ID, "-f", "logs", "-o", "results", cwd=trained)
    assert (trained / "results.pkl").exists(), output


def test_resume_goes_on_with_model_and_data(trained: Path) -> None:
    checkpoint = run_folder(trained) / f"{ENV_ID}.zip"
    before = vars(SAC.load(checkpoint, device="cpu"))["hucrl"]
    run_forked(ZOO, *TRAIN, *SMALL, "-i", str(checkpoint), cwd=trained)
    after = vars(SAC.load(run_folder(trained, 2) / f"{ENV_ID}.zip", device="cpu"))["hucrl"]
    assert before.real_episodes == 3
    assert after.real_episodes == 5
    assert (after.dataset.transitions.states[: 3 * EPISODE_STEPS] == before.dataset.transitions.states).all()


@pytest.mark.parametrize(
    "command",
    [
        [sys.executable, "-m", "rl_zoo3.train", *TRAIN[1:]],
        [sys.executable, "-m", "sb3_hucrl.zoo", *TRAIN],
        [ZOO, *TRAIN, "--vec-env", "subproc"],
    ],
)
def test_other_spellings_work(command: list[str], tmp_path: Path) -> None:
    assert "zoo_hyperparams" in run(*command, *SMALL, cwd=tmp_path)


def test_works_without_the_start_up_file_when_asked_by_name(tmp_path: Path) -> None:
    command = [ZOO, *TRAIN, "--gym-packages", "sb3_hucrl.zoo"]
    assert "zoo_hyperparams" in run(*command, *SMALL, cwd=tmp_path, SB3_HUCRL_ZOO="0")


def test_can_be_switched_off(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match=f"{ENV_ID} not found in gym registry"):
        run(ZOO, *TRAIN, cwd=tmp_path, SB3_HUCRL_ZOO="0")


def test_other_environments_are_as_they_were(tmp_path: Path) -> None:
    outputs = []
    for switch in ("0", "1"):
        output = run(ZOO, "train", "--algo", "ppo", "--env", "CartPole-v1", "-n", "200", "--seed", "1", cwd=tmp_path,
                     SB3_HUCRL_ZOO=switch)  # fmt: skip
        untimed = re.sub(r"CartPole-v1_\d|(fps|time_elapsed) +\| \S+", "", output)
        # The table is as wide as its longest number, which may be a time.
        outputs.append(re.sub(r" +|-{2,}", " ", untimed))
    assert outputs[0] == outputs[1]
    assert "ep_rew_mean" in outputs[0]


def test_h_svg_trains_on_a_robot_without_a_hallucinated_action(tmp_path: Path) -> None:
    robot = "HUCRL-HalfCheetah-v5"
    words = ["train", "--algo", "hsvg", "--env", robot, "-n", "2560", "--eval-freq", "-1", "--seed", "3"]
    short = ["gradient_steps:1", "critic_updates:1", "hucrl_imagined_steps:1280", "hucrl_dynamics__gradient_steps:5"]
    run_forked(ZOO, *words, "-params", *short, "hucrl_initial_steps:1700", "hucrl_real_steps:200", cwd=tmp_path)
    # 1,700 random steps, and 200 after each search: episodes are short at first, and the first long one is not over.
    assert load_results(str(tmp_path / "logs" / "hsvg" / f"{robot}_1"))["l"].to_list() == [200] * 10
    enjoy = ["--algo", "hsvg", "--env", robot, "--no-render", "-n", "1000", "-f", "logs"]
    enjoyed = run_forked(ZOO, "enjoy", *enjoy, cwd=tmp_path)
    assert "Episode Reward" in enjoyed


def test_what_is_redirected_has_a_line_for_each_real_episode_and_no_control_characters(trained: Path) -> None:
    printed = (trained / "printed.txt").read_text()
    lines = [line.split() for line in printed.splitlines() if re.match(LINE, line)]
    progress = pd.read_csv(run_folder(trained) / "progress.csv").dropna(subset=["real/episode"])
    assert [int(line[0]) for line in lines] == progress["real/episode"].tolist() == [1, 2, 3]
    assert [float(line[2]) for line in lines] == pytest.approx(progress["real/return"], abs=0.006)
    assert set(filter(str.isspace, printed)) == {" ", "\n"}
    assert not set(printed) & set("\x1b\r━")
    assert "| real/ " not in printed


def test_an_on_policy_algorithm_prints_lines_or_tables(tmp_path: Path) -> None:
    short = ["-n", "640", *BRIEF, "-params", "n_envs:4", "n_steps:20", "batch_size:80", "n_epochs:1", *SHORT]
    for level, lines, tables in ((0, 0, 0), (1, 1, 0), (2, 0, 3)):
        ppo = ["train", "--algo", "ppo", "--env", ENV_ID, *short, "--verbose", str(level)]
        output = run_forked(ZOO, *ppo, cwd=tmp_path)
        assert output.count("model R²") == lines
        assert output.count("| real/ ") == tables
        assert output.count("| rollout/ ") == (2 if tables else 0)


def test_weights_and_biases_gets_scalars_and_pictures(tmp_path: Path) -> None:
    pytest.importorskip("wandb")
    offline = {"WANDB_MODE": "offline", "WANDB_SILENT": "true"}
    few = ["-n", "640", *BRIEF, "-params", "n_envs:4", *SHORT, "hucrl_real_episodes:5"]
    run(ZOO, *TRAIN, *few, "--track", cwd=tmp_path, **offline)
    [written] = (tmp_path / "wandb").glob("offline-run-*/run-*.wandb")
    content = written.read_bytes()
    for name in (b"real/return", b"dynamics/unseen_r2", b"dynamics/reliability", b"imagined/episode"):
        assert name in content, name
    # A reliability diagram after each refit, and the tenth of the eleven real episodes.
    assert len(list(written.parent.glob("files/media/images/**/*.png"))) == 3 + 1
