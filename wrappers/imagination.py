"""The learned model in place of the real environments, for any SB3 algorithm."""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecFrameStack, VecMonitor, VecNormalize
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from sb3_hucrl.checks import Seed, validated
from sb3_hucrl.imagination import Array, Trajectories, World
from sb3_hucrl.spaces import TIME_LIMIT, require_bounded_box, require_vector_observation

#: real steps without a reset, over all environments, that only a training takes: at least so many, and at least so many
#: episodes of full length; an evaluation begins with a reset, and plays five to ten episodes by default
LONG_STEPS, LONG_EPISODES = 5_000, 20


class ImaginationVecEnv(VecEnvWrapper):
    """
    Passes everything through to the real environments, until :meth:`imagine` puts a learned world in their place.

    In imagination one step is one batched model call for all environments. The end of the horizon is a truncation
    (``TimeLimit.truncated``), an end of the task a termination; both restart the trajectory, and the infos carry
    ``terminal_observation`` and ``episode`` as SB3 expects them.

    A training that is interrupted, by Ctrl-C or an error, does not come to its end, where it would switch back. So
    :meth:`reset`, with which every evaluation begins, asks whether the training that imagines is still running. If it
    is not, the environments are the real ones from then on, and a warning says so. A step before that is refused: it
    would go on with what is imagined. So is a reset by a callback of a training that is running.

    :param venv: real environments, wrapped in :class:`HallucinationWrapper` if the exploration strategy hallucinates
    :raises ValueError: if actions are not bounded and continuous, observations are not vectors, or ``venv`` is wrapped
        in another VecEnv wrapper
    :raises TypeError: if ``venv`` is a single environment
    """

    def __init__(self, venv: VecEnv) -> None:
        if not isinstance(venv, VecEnv):
            raise TypeError(
                f"venv is a {type(venv).__name__}, not a vectorised environment: give ImaginationVecEnv(make_vec_env("
                "..., n_envs=32)), because imagination steps all environments as one batch"
            )
        if isinstance(venv, VecEnvWrapper):
            raise ValueError(
                f"{type(venv).__name__} lies inside ImaginationVecEnv, where real episodes bypass it: "
                f"{_instead_of(venv)}"
            )
        super().__init__(venv)
        self._action_shape = (venv.num_envs, *require_bounded_box(venv.action_space).shape)
        require_vector_observation(venv.observation_space)
        self._trajectories: Trajectories | None = None
        self._actions: Array = np.empty(0, dtype=np.float32)
        self._is_training: Callable[[], bool] | None = None
        # Real steps since the last reset; None once there is no need to count them any longer.
        self._real_steps: int | None = 0 if venv.num_envs > 1 else None

    @property
    def trajectories(self) -> Trajectories | None:
        """The imagined trajectories, or None while the environments are the real ones."""
        return self._trajectories

    @validated
    def imagine(self, world: World, seed: Seed | None = None, is_training: Callable[[], bool] | None = None) -> None:
        """
        Switch into imagination; call ``reset()`` next.

        :param world: to imagine
        :param seed: of the noise and the start states; by default the world's own
        :param is_training: whether the training that imagines is still running, asked at each reset; by default
            imagination lasts until :meth:`real`
        :raises ValueError: if the world's actions are not those of the environments
        """
        if world.action_space != self.action_space:
            raise ValueError(
                f"the world's actions are {world.action_space}, those of the environments {self.action_space}: make "
                "the world for these environments"
            )
        self._trajectories = world.trajectories(self.num_envs, seed)
        self._is_training, self._real_steps = is_training, None

    def real(self) -> None:
        """Switch back to the real environments; call ``reset()`` next."""
        self._trajectories = self._is_training = None

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        if self._trajectories is not None and seed is not None:
            self._trajectories.seed(seed)
        return super().seed(seed)

    @property
    def _was_interrupted(self) -> bool:
        return self._is_training is not None and not self._is_training()

    def reset(self) -> VecEnvObs:
        if self._was_interrupted:
            warnings.warn(
                "the training that imagined these environments was interrupted: from this reset on they are the real "
                "ones again",
                stacklevel=2,
            )
            self.real()
        if self._trajectories is None:
            self._real_steps = None if self._real_steps is None else 0
            observations = self.venv.reset()
            self.reset_infos = self.venv.reset_infos
            return observations
        if self._is_training is not None and _is_within_a_callback():
            raise RuntimeError(
                "a callback evaluates in the environments of the training, which are imagined: it would report "
                "imagined returns, and end the trajectories of the search; give it real ones, make_vec_env(...)"
            )
        self.reset_infos = [{} for _ in range(self.num_envs)]
        return self._trajectories.reset()

    def step_async(self, actions: np.ndarray) -> None:
        if self._trajectories is None:
            self.venv.step_async(actions)
            return
        if self._was_interrupted:
            raise RuntimeError(
                "the training that imagined these environments was interrupted, and they were not reset since: call "
                "reset(), which makes them the real ones again, or go on with learn(..., callback=HUCRLCallback())"
            )
        if np.shape(actions) != self._action_shape:
            raise ValueError(
                f"the actions have shape {np.shape(actions)}: {self.num_envs} environments take {self._action_shape}"
            )
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        trajectories = self._trajectories
        if trajectories is None:
            results = self.venv.step_wait()
            self.reset_infos = self.venv.reset_infos
            self._count_real_step()
            return results
        step = trajectories.step(self._actions)
        observations, dones = step.observations, step.terminated | step.truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        finished = np.flatnonzero(dones)
        if len(finished):
            for index in finished:
                infos[index] = {
                    "terminal_observation": observations[index],
                    "TimeLimit.truncated": bool(step.truncated[index] and not step.terminated[index]),
                    "episode": {"r": float(trajectories.returns[index]), "l": int(trajectories.lengths[index])},
                }
            observations = observations.copy()
            observations[finished] = trajectories.reset(finished)
        return observations, step.rewards, dones, infos

    def _count_real_step(self) -> None:
        if self._real_steps is None:
            return
        self._real_steps += self.num_envs
        if self._real_steps < LONG_STEPS:
            return
        time_limit = self.venv.get_attr(TIME_LIMIT, indices=0)[0] if self.venv.has_attr(TIME_LIMIT) else 0
        if self._real_steps >= LONG_EPISODES * time_limit:
            self._real_steps = None
            warnings.warn(
                f"{self.num_envs} real environments have been stepped for long, and nothing was imagined: if this is a "
                "training, give it HUCRLCallback: model.learn(..., callback=HUCRLCallback()), in a YAML file "
                "callback: sb3_hucrl.HUCRLCallback",
                stacklevel=2,
            )


def _is_within_a_callback() -> bool:
    # Algorithms such as ARS reset the environments too, but in no step of a callback.
    frame = inspect.currentframe()
    while frame is not None:
        if frame.f_code.co_name == "on_step" and isinstance(frame.f_locals.get("self"), BaseCallback):
            return True
        frame = frame.f_back
    return False


def _instead_of(wrapper: VecEnvWrapper) -> str:
    if isinstance(wrapper, VecNormalize):
        return "put it around, VecNormalize(ImaginationVecEnv(vec_env)), in a YAML file normalize: true"
    if isinstance(wrapper, ImaginationVecEnv):
        return "leave one of the two out"
    if isinstance(wrapper, VecMonitor):
        return "leave it out, because make_vec_env has put a Monitor around each environment"
    if isinstance(wrapper, VecFrameStack):
        return (
            "stack in each environment, make_vec_env(..., wrapper_class=lambda env: FlattenObservation("
            "FrameStackObservation(env, 4))), with the wrappers of gymnasium"
        )
    return "use a gymnasium wrapper around each environment, make_vec_env(..., wrapper_class=...)"


def imagination_layer(env: VecEnv) -> tuple[ImaginationVecEnv | None, list[VecEnvWrapper]]:
    """
    :param env: a stack of vectorised environments
    :return: the ImaginationVecEnv in it, if there is one, and the wrappers above it
    """
    layer, above = env, []
    while isinstance(layer, VecEnvWrapper) and not isinstance(layer, ImaginationVecEnv):
        above.append(layer)
        layer = layer.venv
    return (layer if isinstance(layer, ImaginationVecEnv) else None), above
