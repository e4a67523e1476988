"""The package's environments: gymnasium's and SB3's contracts, seeds, frames, kinematics."""

from __future__ import annotations

import math
import pickle

import gymnasium as gym
import mujoco
import numpy as np
import pytest
import torch as th
from gymnasium.envs.mujoco.half_cheetah_v5 import HalfCheetahEnv as Original
from gymnasium.utils.env_checker import check_env as gymnasium_check_env
from stable_baselines3.common.env_checker import check_env as sb3_check_env

from sb3_hucrl.dynamics.truth import TrueDynamics
from sb3_hucrl.envs import ENVIRONMENTS, MAX_EPISODE_STEPS, make_env
from sb3_hucrl.envs.half_cheetah import HalfCheetahEnv
from sb3_hucrl.envs.mujoco_base import MujocoTaskEnv
from sb3_hucrl.envs.pusher import PusherEnv
from sb3_hucrl.envs.reacher import ReacherEnv
from sb3_hucrl.tasks.arm_kinematics import hand_position
from sb3_hucrl.tasks.pusher import BASE as PUSHER_BASE
from sb3_hucrl.tasks.reacher import BASE as REACHER_BASE
from sb3_hucrl.tasks.reacher import TOOL_LENGTH
from sb3_hucrl.tasks.registry import find_task

MUJOCO = [env_id for env_id in ENVIRONMENTS if "Pendulum" not in env_id]
#: state dimensions, action dimensions, largest action, steps
SHAPES = {
    "HUCRL-Pendulum-v0": (2, 1, 1.0, 400),
    "HUCRL-CartPole-v0": (4, 1, 3.0, 200),
    "HUCRL-Reacher-v0": (14, 7, 20.0, 150),
    "HUCRL-SparseReacher-v0": (14, 7, 20.0, 150),
    "HUCRL-Pusher-v0": (16, 7, 2.0, 150),
    "HUCRL-HalfCheetah-v0": (17, 6, 2.0, 1000),
}


def mujoco_env(env_id: str) -> MujocoTaskEnv:
    env = gym.make(env_id, hallucinate=False).unwrapped
    assert isinstance(env, MujocoTaskEnv)
    return env


def test_makes_as_much_room_for_hallucination_as_is_asked_for() -> None:
    assert gym.make("HUCRL-Pendulum-v0").action_space.shape == (3,)
    assert gym.make("HUCRL-Pendulum-v0", hallucinated_dim=3).action_space.shape == (4,)


@pytest.mark.parametrize("env_id", MUJOCO)
@pytest.mark.parametrize("hallucinate", [True, False])
def test_passes_both_env_checks(env_id: str, hallucinate: bool) -> None:
    env = gym.make(env_id, hallucinate=hallucinate)
    gymnasium_check_env(env.unwrapped, skip_render_check=True)
    sb3_check_env(env)


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_has_the_papers_shape(env_id: str) -> None:
    state_dim, action_dim, bound, steps = SHAPES[env_id]
    env = gym.make(env_id)
    assert env.spec is not None
    assert env.spec.max_episode_steps == steps
    box = env.action_space
    assert isinstance(box, gym.spaces.Box)
    assert box.shape == (action_dim + state_dim,)
    np.testing.assert_array_equal(box.high, [bound] * action_dim + [1.0] * state_dim)
    np.testing.assert_array_equal(box.low, -box.high)


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_the_same_seed_gives_the_same_episode_and_another_does_not(env_id: str) -> None:
    def episode(seed: int) -> np.ndarray:
        env = gym.make(env_id)
        env.action_space.seed(seed)
        rows = [env.reset(seed=seed)[0]]
        rows += [env.step(env.action_space.sample())[0] for _ in range(30)]
        return np.stack(rows)

    np.testing.assert_array_equal(episode(1), episode(1))
    assert (episode(1) != episode(2)).any()


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_goes_on_from_a_state_that_is_set(env_id: str) -> None:
    spec = gym.spec(env_id)
    task = find_task(spec, observation_dim=0)
    assert task is not None
    env, other = gym.make(env_id, hallucinate=False), gym.make(env_id, hallucinate=False)
    env.action_space.seed(0)
    observation, _ = env.reset(seed=0)
    other.reset(seed=1)
    truth = TrueDynamics(task.state_dim, 1, env=env_id)
    truth = pickle.loads(pickle.dumps(truth))
    for _ in range(20):
        state = task.state(th.as_tensor(observation)[None])
        np.testing.assert_allclose(other.get_wrapper_attr("set_state")(state[0]), observation, atol=1e-6)
        action = env.action_space.sample()
        observation, *_ = env.step(action)
        np.testing.assert_allclose(other.unwrapped.step(action)[0], observation, atol=1e-4, rtol=1e-4)
        prediction = truth.predict(state[:, : task.state_dim], th.as_tensor(action)[None])
        expected = task.state(th.as_tensor(observation)[None])[:, : task.state_dim]
        th.testing.assert_close(prediction.mean, expected, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("env_id", MUJOCO)
def test_actions_are_clipped_and_cost_their_penalty(env_id: str) -> None:
    rewards = {}
    for scale in (1.0, 5.0):
        for penalty in (0.0, 1.0):
            env = gym.make(env_id, hallucinate=False, action_penalty=penalty, disable_env_checker=True)
            env.reset(seed=0)
            assert isinstance(env.action_space, gym.spaces.Box)
            _, rewards[scale, penalty], *_ = env.step(scale * env.action_space.high)
    assert rewards[1.0, 0.0] == rewards[5.0, 0.0]
    assert rewards[1.0, 1.0] == rewards[5.0, 1.0]
    assert float(rewards[1.0, 0.0]) - float(rewards[1.0, 1.0]) > 0.99


def test_hands_are_where_mujoco_puts_them() -> None:
    rng = np.random.default_rng(0)
    reacher, pusher = ReacherEnv(), PusherEnv()
    for _ in range(200):
        angles = rng.uniform(-math.pi, math.pi, 7)
        batch = th.as_tensor(angles)[None]
        for env in (reacher, pusher):
            env.data.qpos[:7] = angles
            mujoco.mj_kinematics(env.model, env.data)
        tool = hand_position(batch, REACHER_BASE, TOOL_LENGTH)[0]
        np.testing.assert_allclose(tool, reacher.data.site("tool").xpos, atol=1e-5)
        hand = hand_position(batch, PUSHER_BASE, 0.0)[0]
        np.testing.assert_allclose(hand, pusher.data.body("tips_arm").xpos, atol=1e-5)


def test_cart_pole_hangs_at_rest_and_is_worth_most_upright() -> None:
    env = mujoco_env("HUCRL-CartPole-v0")
    for theta, reward in ((0.0, math.exp(-4.0)), (math.pi, 1.0)):
        env.reset(seed=0)
        env.data.qpos[:] = [0.0, theta]
        env.data.qvel[:] = 0.0
        observation, found, *_ = env.step(np.zeros(1, dtype=np.float32))
        assert found == pytest.approx(reward, abs=1e-6)
        np.testing.assert_allclose(observation, [0, math.cos(theta), 0, 0, 0], atol=1e-6)


def test_cart_stays_on_its_rail() -> None:
    env = mujoco_env("HUCRL-CartPole-v0")
    env.reset(seed=0)
    for _ in range(100):
        observation, *_ = env.step(np.full(1, 3.0, dtype=np.float32))
    assert 2.0 < observation[2] < 2.7


def test_reacher_keeps_to_its_joint_ranges() -> None:
    env = ReacherEnv()
    env.reset(seed=0)
    env.action_space.seed(0)
    limited = env.model.jnt_limited.astype(bool)
    assert limited.tolist() == [True, True, True, True, False, True, False]
    low, high = env.model.jnt_range[limited].T
    for _ in range(600):
        env.step(env.action_space.sample())
        # MuJoCo's limits are springs, and these motors are strong.
        assert bool(((env.data.qpos[limited] > low - 0.6) & (env.data.qpos[limited] < high + 0.6)).all())


def test_half_cheetah_is_gymnasiums_but_for_its_motors() -> None:
    ours, theirs = HalfCheetahEnv().model, Original().model
    for name in ("body_mass", "body_inertia", "dof_damping", "jnt_stiffness", "dof_invweight0", "geom_friction"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)
    np.testing.assert_array_equal(ours.actuator_ctrlrange, 2 * theirs.actuator_ctrlrange)


def test_pushers_object_moves_only_when_it_is_touched() -> None:
    env = PusherEnv()
    before, _ = env.reset(seed=0)
    after = env.step(np.zeros(7, dtype=np.float32))[0]
    np.testing.assert_array_equal(before[21:24], after[21:24])
    assert before[22] - before[25] == pytest.approx(-0.25, abs=0.1)
    assert before[21] - before[24] == pytest.approx(0.15, abs=0.1)


@pytest.mark.parametrize("env_id", MUJOCO)
def test_renders_a_frame_that_moves(env_id: str) -> None:
    env = gym.make(env_id, render_mode="rgb_array")
    env.reset(seed=0)
    try:
        before = env.render()
    except Exception as error:  # its type depends on the missing driver
        pytest.skip(f"no OpenGL here: {error}")
    env.action_space.seed(0)
    for _ in range(20):
        env.step(env.action_space.sample())
    after = env.render()
    env.close()
    assert isinstance(before, np.ndarray)
    assert isinstance(after, np.ndarray)
    assert before.shape == (480, 480, 3)
    assert before.std() > 5
    assert (before != after).any()


@pytest.mark.parametrize("env_id", MUJOCO)
def test_bad_arguments_say_what_to_do(env_id: str) -> None:
    with pytest.raises(ValueError, match=r"action_penalty is -0\.1"):
        gym.make(env_id, action_penalty=-0.1)
    with pytest.raises(ValueError, match="render_mode is 'ascii': give 'human' or 'rgb_array'"):
        gym.make(env_id, render_mode="ascii")


def test_an_unknown_argument_has_a_neighbour() -> None:
    with pytest.raises(ValueError, match=r"hallucinat is no argument of PendulumEnv \(did you mean 'hallucinate'"):
        gym.make("HUCRL-Pendulum-v0", hallucinat=False)
    with pytest.raises(ValueError, match="did you mean 'action_penalty'"):
        gym.make("HUCRL-Pendulum-v0", action_penalt=0.2)


def test_an_unknown_environment_lists_the_known_ones() -> None:
    assert set(ENVIRONMENTS) == set(MAX_EPISODE_STEPS)
    with pytest.raises(ValueError, match=r"unknown environment .*-v1': .*did you mean 'HUCRL-Pendulum-v0'"):
        make_env("HUCRL-Pendulum-v1")


@pytest.mark.parametrize("env_id", ["HUCRL-Hopper-v5", "HUCRL-MountainCarContinuous-v0"])
def test_environments_whose_state_cannot_be_set_have_no_true_dynamics(env_id: str) -> None:
    with pytest.raises(ValueError, match=f"the state of {env_id} cannot be set from what is observed"):
        TrueDynamics(2, 1, env=env_id)
