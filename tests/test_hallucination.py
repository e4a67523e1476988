"""The real environment with an action space that includes a′."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env as gymnasium_check_env
from gymnasium.wrappers import DtypeObservation, FlattenObservation, TransformAction, TransformObservation
from stable_baselines3.common.env_checker import check_env as sb3_check_env

from helpers import ENV_ID
from sb3_hucrl import HallucinationWrapper


def test_passes_both_env_checks() -> None:
    env = HallucinationWrapper(gym.make("Pendulum-v1", render_mode="rgb_array"))
    gymnasium_check_env(env, skip_render_check=True)
    sb3_check_env(env)


def test_widens_by_the_tasks_state_and_by_the_observation_where_there_is_no_task() -> None:
    known = HallucinationWrapper(gym.make("Pendulum-v1"))
    assert known.action_space == spaces.Box(np.array([-2, -1, -1], np.float32), np.array([2, 1, 1], np.float32))
    unknown = HallucinationWrapper(gym.make("MountainCarContinuous-v0"))
    assert unknown.action_space.shape == (1 + 2,)
    assert HallucinationWrapper(gym.make("Pendulum-v1"), hallucinated_dim=3).action_space.shape == (4,)


def test_the_hallucinated_action_never_reaches_the_real_environment() -> None:
    plain, wrapped = (gym.make(ENV_ID, hallucinate=hallucinate) for hallucinate in (False, True))
    rng = np.random.default_rng(0)
    plain.reset(seed=0)
    wrapped.reset(seed=0)
    for _ in range(100):
        action = rng.uniform(-1, 1, 3).astype(np.float32)
        expected = plain.step(action[:1])
        outcome = wrapped.step(action)
        np.testing.assert_array_equal(outcome[0], expected[0])
        assert outcome[1:4] == expected[1:4]
        np.testing.assert_array_equal(outcome[4]["hallucinated_action"], action[1:])


class OddSpaces(gym.Env):
    """An environment with the given spaces, which is never stepped."""

    def __init__(self, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]) -> None:
        self.observation_space, self.action_space = observation_space, action_space


VECTOR, TORQUE = spaces.Box(-1, 1, (3,)), spaces.Box(-1, 1, (1,))


@pytest.mark.parametrize(
    ("observation_space", "action_space", "message"),
    [
        (VECTOR, spaces.Discrete(2), r"action space is Discrete\(2\).* needs continuous actions"),
        (VECTOR, spaces.Box(-np.inf, np.inf, (1,)), "is unbounded: give all actions finite limits"),
        (VECTOR, spaces.Box(-1, 1, (2, 2)), r"shape \(2, 2\) .*TransformAction"),
        (VECTOR, spaces.Box(np.array([-1, 0]), np.array([1, np.inf])), "is unbounded"),
        (VECTOR, spaces.Box(np.array([-1, 3]), np.array([1, 3])), r"low = high in dimensions \[1\]"),
        (VECTOR, spaces.Box(0, 9, (1,), dtype=np.int64), r"dtype int64.*TransformAction"),
        (spaces.Box(0, 9, (2,), dtype=np.int64), TORQUE, r"DtypeObservation\(env, np.float32\)"),
        (spaces.Box(-1, 1, (2, 2)), TORQUE, "small matrices with gymnasium.wrappers.FlattenObservation"),
        (
            spaces.Discrete(4),
            TORQUE,
            r"observation space is Discrete\(4\).*FlattenObservation, and in DtypeObservation",
        ),
        (spaces.Dict(position=VECTOR), TORQUE, "FlattenObservation"),
        (spaces.Box(0, 255, (64, 64, 3), dtype=np.uint8), TORQUE, "images are not supported"),
    ],
)
def test_other_spaces_are_refused_with_advice(
    observation_space: spaces.Space[Any], action_space: spaces.Space[Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        HallucinationWrapper(OddSpaces(observation_space, action_space))


def test_wraps_environments_that_are_wrapped_already() -> None:
    inner = gym.make("Pendulum-v1")
    env = HallucinationWrapper(TransformObservation(inner, lambda observation: observation, inner.observation_space))
    assert env.action_space.shape == (3,)
    assert env.spec is not None
    assert env.spec.id == "Pendulum-v1"


def test_the_advice_for_other_spaces_leads_to_an_accepted_environment() -> None:
    one_hot = DtypeObservation(FlattenObservation(OddSpaces(spaces.Discrete(4), TORQUE)), np.float32)
    assert HallucinationWrapper(one_hot).hallucinated_dim == 4
    flat = spaces.Box(-1, 1, (4,))
    grid = TransformAction(OddSpaces(VECTOR, spaces.Box(-1, 1, (2, 2))), lambda a: a.reshape(2, 2), flat)
    assert HallucinationWrapper(grid).action_space.shape == (7,)
    matrix = OddSpaces(spaces.Box(-1, 1, (2, 2)), TORQUE)
    assert HallucinationWrapper(FlattenObservation(matrix)).hallucinated_dim == 4


@pytest.mark.parametrize("shape", [(1,), (2,), (5,), (1, 4), ()])
def test_an_action_of_another_shape_is_refused(shape: tuple[int, ...]) -> None:
    env = HallucinationWrapper(gym.make("Pendulum-v1"), 3)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"the action has shape .*this environment takes \(4,\); .*same hallucinate"):
        env.step(np.zeros(shape, dtype=np.float32))


def test_room_is_made_once() -> None:
    with pytest.raises(ValueError, match="has room for a′ already, as every environment has whose id begins"):
        HallucinationWrapper(gym.make("HUCRL-Pendulum-v1"))
    assert HallucinationWrapper(gym.make("HUCRL-Pendulum-v1", hallucinate=False)).hallucinated_dim == 2
