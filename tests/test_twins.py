"""``HUCRL-X`` is ``X`` with room for a′, whatever registers ``X``, and whenever."""

from __future__ import annotations

import pickle
import warnings
from collections.abc import Iterator, Mapping
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import WrapperSpec
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as sb3_check_env

from sb3_hucrl.envs import ENVIRONMENTS, register_envs
from sb3_hucrl.tasks import GymnasiumPendulumTask, LocomotionTask, Task, find_task, register_task
from sb3_hucrl.tasks.registry import TASKS

TWINS = ["HUCRL-Pendulum-v1", "HUCRL-MountainCarContinuous-v0", "HUCRL-Hopper-v5", "HUCRL-HalfCheetah-v5"]


class Slide(gym.Env[np.ndarray, np.ndarray]):
    """A user's environment, which no task is known for."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  # as gymnasium has it
    action_space = gym.spaces.Box(-1, 1, (1,), np.float32)

    def __init__(self, size: int = 2, render_mode: str | None = None) -> None:
        self.size = size
        self.observation_space = gym.spaces.Box(-1, 1, (size,), np.float32)
        self.render_mode = render_mode

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        super().reset(seed=seed)
        return np.zeros(self.size, np.float32), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        assert action.shape == (1,)
        return np.zeros(self.size, np.float32), 0.0, False, False, {}

    def render(self) -> np.ndarray:
        return np.zeros((8, 8, 3), np.uint8)


class Twice(gym.Wrapper[np.ndarray, np.ndarray, np.ndarray, np.ndarray], gym.utils.RecordConstructorArgs):
    """Repeats each action, so that a time limit below it counts differently from one above."""

    def __init__(self, env: gym.Env[np.ndarray, np.ndarray]) -> None:
        gym.utils.RecordConstructorArgs.__init__(self)
        super().__init__(env)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, Any, bool, bool, dict[str, Any]]:
        self.env.step(action)
        return self.env.step(action)


@pytest.fixture(autouse=True)
def registries() -> Iterator[None]:
    """Both as they were."""
    specs, targets = dict(gym.registry), dict(TASKS.targets)
    yield
    gym.registry.clear()
    gym.registry.update(specs)
    TASKS.targets.clear()
    TASKS.targets.update(targets)


def register(env_id: str, target: Any = None, **kwargs: Any) -> None:
    """gymnasium's own, which wants entry points without arguments of their own."""
    gym.register(env_id, target, **kwargs)


def episode(env: gym.Env[Any, Any], actions: list[np.ndarray]) -> list[np.ndarray]:
    """Observations, rewards and ends, without a′."""
    observation, _ = env.reset(seed=3)
    rows = [observation]
    for action in actions:
        observation, reward, terminated, truncated, _ = env.step(action)
        rows.append(np.append(observation, [float(reward), terminated, truncated]))
        if terminated or truncated:
            break
    return rows


def steps_until_truncated(env: gym.Env[Any, Any]) -> int:
    env.reset(seed=0)
    for count in range(1, 100):
        if env.step(np.zeros(env.action_space.shape, np.float32))[3]:
            return count
    raise AssertionError("not truncated")


@pytest.mark.parametrize("env_id", TWINS)
def test_plays_the_same_episode_as_the_original_whatever_is_hallucinated(env_id: str) -> None:
    original, twin = gym.make(env_id.removeprefix("HUCRL-")), gym.make(env_id)
    original.action_space.seed(0)
    actions = [original.action_space.sample() for _ in range(300)]
    room = len(twin.action_space.sample()) - len(actions[0])
    wide = [np.append(action, np.linspace(-1, 1, room)).astype(np.float32) for action in actions]
    assert room > 0
    expected, found = episode(original, actions), episode(twin, wide)
    assert len(expected) == len(found)
    for one, other in zip(expected, found, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("env_id", TWINS)
def test_passes_both_checks(env_id: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        check_env(gym.make(env_id), skip_render_check=True)
        sb3_check_env(gym.make(env_id))


def test_the_specification_is_that_of_the_original_but_for_id_and_entry_point() -> None:
    original, twin = gym.spec("Hopper-v5"), gym.spec("HUCRL-Hopper-v5")
    assert twin.id == "HUCRL-Hopper-v5"
    for name in ("max_episode_steps", "reward_threshold", "nondeterministic", "order_enforce", "kwargs", "version"):
        assert getattr(twin, name) == getattr(original, name)
    made = gym.make("HUCRL-Hopper-v5").spec
    assert made is not None
    assert (made.id, made.max_episode_steps) == ("HUCRL-Hopper-v5", 1000)
    assert made.make().action_space.shape == (3 + 11,)


def test_there_is_one_time_limit_which_make_can_change() -> None:
    assert str(gym.make("HUCRL-Pendulum-v1")).count("TimeLimit") == 1
    assert steps_until_truncated(gym.make("HUCRL-MountainCarContinuous-v0", max_episode_steps=5)) == 5
    register("Slide-v0", Slide, max_episode_steps=5)
    assert steps_until_truncated(gym.make("HUCRL-Slide-v0")) == 5
    assert steps_until_truncated(gym.make("HUCRL-Slide-v0", max_episode_steps=50)) == 50


def test_registered_wrappers_stay_between_time_limit_and_room() -> None:
    repeat = WrapperSpec("Twice", f"{__name__}:Twice", {})
    register("Slide-v0", Slide, max_episode_steps=10, additional_wrappers=(repeat,))
    for env_id in ("Slide-v0", "HUCRL-Slide-v0"):
        env = gym.make(env_id)
        assert steps_until_truncated(env) == 5
        assert env.spec is not None
        assert env.spec.max_episode_steps == 10


def test_arguments_are_the_original_s_and_two_more() -> None:
    register("Slide-v0", Slide, kwargs={"size": 3})
    assert gym.make("HUCRL-Slide-v0").action_space.shape == (1 + 3,)
    assert gym.make("HUCRL-Slide-v0", size=5).action_space.shape == (1 + 5,)
    assert gym.make("HUCRL-Slide-v0", hallucinated_dim=2).action_space.shape == (1 + 2,)
    assert gym.make("HUCRL-Slide-v0", hallucinate=False).action_space.shape == (1,)
    with pytest.raises(TypeError, match="siez"):
        gym.make("HUCRL-Slide-v0", siez=5)


def test_renders_as_the_original_does() -> None:
    register("Slide-v0", Slide, max_episode_steps=5)
    env = gym.make("HUCRL-Slide-v0", render_mode="rgb_array")
    env.reset()
    frame = env.render()
    assert isinstance(frame, np.ndarray)
    assert frame.shape == (8, 8, 3)
    with pytest.warns(UserWarning, match="HumanRendering"):
        assert gym.make("HUCRL-Slide-v0", render_mode="human").render_mode == "human"


def test_a_process_that_has_not_registered_the_original_can_make_it() -> None:
    register("Slide-v0", f"{__name__}:Slide")
    spec = pickle.dumps(gym.spec("HUCRL-Slide-v0"))
    del gym.registry["Slide-v0"], gym.registry["HUCRL-Slide-v0"]
    assert pickle.loads(spec).make().action_space.shape == (1 + 2,)


def test_has_the_task_of_the_original_with_its_arguments() -> None:
    assert isinstance(find_task(gym.spec("HUCRL-Pendulum-v1"), 3), GymnasiumPendulumTask)
    env = gym.make("HUCRL-Hopper-v5", healthy_z_range=(0.5, 9.0), hallucinated_dim=4)
    assert isinstance(find_task(env.spec, 11), LocomotionTask)
    seen: list[Mapping[str, Any]] = []

    def factory(kwargs: Mapping[str, Any], observation_dim: int) -> Task:
        seen.append(kwargs)
        return LocomotionTask(observation_dim, {})

    register_task("Hopper-v5", factory)
    find_task(env.spec, 11)
    assert seen == [{"healthy_z_range": (0.5, 9.0)}]


def test_a_task_of_its_own_goes_before_that_of_the_original() -> None:
    register_task("HUCRL-Hopper-v5", lambda kwargs, observation_dim: GymnasiumPendulumTask())
    assert gym.make("HUCRL-Hopper-v5").action_space.shape == (3 + 2,)
    assert isinstance(find_task(gym.spec("Hopper-v5"), 11), LocomotionTask)


@pytest.mark.parametrize(
    ("env_id", "message"),
    [
        ("HUCRL-CartPole-v1", "there is no HUCRL-CartPole-v1: the action space is Discrete.*choose"),
        ("HUCRL-Blackjack-v1", "the observation space is Tuple.*FlattenObservation"),
        ("HUCRL-CarRacing-v3", "images are not supported, expose the state"),
        ("HUCRL-Unbounded-v0", "unbounded: give all actions finite limits"),
    ],
)
def test_other_spaces_are_refused_by_one_error(env_id: str, message: str) -> None:
    class Unbounded(Slide):
        action_space = gym.spaces.Box(-np.inf, np.inf, (1,), np.float32)

    class Pictures(Slide):
        def __init__(self) -> None:
            super().__init__()
            self.observation_space = gym.spaces.Box(0, 255, (8, 8, 3), np.uint8)

    register("Unbounded-v0", Unbounded)
    del gym.registry["CarRacing-v3"]  # it needs Box2D
    register("CarRacing-v3", Pictures)
    with pytest.raises(ValueError, match=message) as error:
        gym.make(env_id)
    assert error.value.__cause__ is None
    assert error.value.__suppress_context__


def test_every_environment_has_a_twin_and_no_twin_has_one() -> None:
    originals = [env_id for env_id in gym.registry if not env_id.startswith("HUCRL-")]
    assert len(originals) > 50
    assert gym.registry.keys() == {*originals, *(f"HUCRL-{env_id}" for env_id in originals), *ENVIRONMENTS}


def test_the_paper_s_environments_are_not_called_out_of_date() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for env_id in ENVIRONMENTS:
            assert gym.make(env_id).spec is not None
    assert gym.spec("HUCRL-Pendulum-v0").entry_point == "sb3_hucrl.envs:make_env"


@pytest.mark.parametrize("module", [gym, gym.envs, gym.envs.registration])
def test_registering_later_makes_the_twin(module: Any) -> None:
    module.register("Slide-v0", Slide, max_episode_steps=5)
    assert steps_until_truncated(gym.make("HUCRL-Slide-v0")) == 5


def test_registering_again_replaces_the_twin() -> None:
    register("Slide-v0", Slide, max_episode_steps=5)
    with pytest.warns(UserWarning, match="Overriding environment Slide-v0"):
        register("Slide-v0", Slide, max_episode_steps=7)
    assert steps_until_truncated(gym.make("HUCRL-Slide-v0")) == 7
    del gym.registry["Slide-v0"]
    register_envs()
    assert "HUCRL-Nowhere-v0" not in gym.registry


def test_an_environment_of_the_user_s_own_goes_before_a_twin() -> None:
    register("Slide-v1", Slide)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        register("HUCRL-Slide-v0", Slide)
        assert gym.make("HUCRL-Slide-v0").action_space.shape == (1,)
        assert gym.make("HUCRL-Slide-v1").action_space.shape == (1 + 2,)
        register("HUCRL-Slide-v1", Slide)
        register_envs()
        assert gym.make("HUCRL-Slide-v1").action_space.shape == (1,)
        register("HUCRL-Hopper", Slide)
        assert gym.make("HUCRL-Hopper").action_space.shape == (1,)
        assert gym.make("HUCRL-Hopper-v5").action_space.shape == (3 + 11,)


def test_what_gymnasium_says_of_a_wrong_registration_stays() -> None:
    with pytest.raises(ValueError, match="must be provided"):
        register("Nowhere-v0")
    assert "HUCRL-Nowhere-v0" not in gym.registry


def test_a_script_can_catch_up_with_what_it_registered_otherwise() -> None:
    spec = gym.spec("Pendulum-v1")
    gym.registry["Hanging-v1"] = gym.envs.registration.EnvSpec("Hanging-v1", spec.entry_point)
    assert "HUCRL-Hanging-v1" not in gym.registry
    register_envs()
    assert gym.make("HUCRL-Hanging-v1").action_space.shape == (1 + 3,)
