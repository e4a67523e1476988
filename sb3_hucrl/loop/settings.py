"""Settings of the outer loop, in four groups."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sb3_hucrl.checks import (
    ArgumentError,
    Count,
    Fraction,
    Natural,
    NotNegative,
    Positive,
    Real,
    require_arguments,
    validated,
    within,
)
from sb3_hucrl.dynamics import DYNAMICS, DynamicsModel
from sb3_hucrl.exploration import ExplorationStrategy, Optimistic
from sb3_hucrl.imagination import StartStates
from sb3_hucrl.loop.schedule import EarlyTimeLimit, HorizonSchedule, RewardSeeking
from sb3_hucrl.planning import PlanningSettings
from sb3_hucrl.tasks import Task
from sb3_hucrl.tasks.registry import require_task_arguments

#: arguments of dynamics models that come from the environment
NOT_FOR_USERS = ("state_dim", "action_dim", "angle_dims", "generator")


@validated
@dataclass(frozen=True)
class RealSettings:
    """
    Real episodes. They are played in rounds of ``real_envs`` at once, so that there may be a few more than asked for.

    :param initial_episodes: random ones before the first search, at least 1; None for 1, or for none where there are
        logged data and no ``initial_steps``
    :param initial_steps: steps that these have together, at least; None for one full-length episode, or 200 steps if
        that is less
    :param seek_reward: ``[hold, until]``: where random episodes have met no reward, see
        :func:`sb3_hucrl.loop.meets_reward`, their actions are held for up to ``hold`` steps, and they go on until they
        do, or until ``until`` real steps; None for neither
    :param real_episodes: after each search, at least 1
    :param real_steps: steps that these have together, at least; None as above
    :param real_envs: number of environments in which they are played at once, at least 1
    :param max_real_steps: that end the training, with the episode that is under way; None for no such number
    :param sampling_fraction: fraction of the training in which they sample the policy, in [0, 1]
    :param reward_threshold: a return, mean of a round, that ends the training; None for none
    :param whole_episodes: whether refits wait for the end of a real episode. If not, the real environment waits for the
        search: after ``initial_steps`` and ``real_steps``, and not more, the episode goes on with a new policy. Only
        the last policy plays on to the end of its episode
    :param early_time_limit: ``[steps, until]``: real episodes that begin before ``until`` real steps end after
        ``steps``, and do not count for the ``reward_threshold``; None for the environment's time limit in all of them
    :raises ValueError: if a number is out of its range
    """

    initial_episodes: Count | None = None
    initial_steps: Count | None = None
    seek_reward: Sequence[Natural] | None = None
    real_episodes: Count = 1
    real_steps: Count | None = None
    real_envs: Count = 1
    max_real_steps: Count | None = None
    sampling_fraction: Fraction = 0.5
    reward_threshold: Real | None = None
    whole_episodes: bool = True
    early_time_limit: Sequence[Natural] | None = None

    def __post_init__(self) -> None:
        if self.early_time_limit is not None:
            EarlyTimeLimit.read(self.early_time_limit)
        if self.seek_reward is not None:
            RewardSeeking.read(self.seek_reward)


@validated
@dataclass(frozen=True)
class SearchSettings:
    """
    Policy search in imagination.

    :param strategy: how imagination uses uncertainty
    :param imagined_steps: timesteps of each search, over all imagined trajectories; None for 64 for each real step
        since the last one, and up to 128 where these are few
    :param horizon: length of an imagined trajectory, or ``[first, last, begin, end]`` to let it grow between these
        numbers of real steps; None for as long as the model can be trusted
    :param start_states: weights of the kinds of start states, see :class:`sb3_hucrl.imagination.StartStates`
    :param real_data_fraction: fraction of real transitions in each batch of an off-policy algorithm, in [0, 1]
    :param stale_fraction: fraction of its replay buffer kept after a refit, newest first, in [0, 1]
    :param uncertainty_cap: multiple of the usual uncertainty at which trajectories are truncated; None for never
    :param standardise: whether the policy's networks see observations with mean 0 and standard deviation 1
    :raises ValueError: if a number is out of its range
    """

    strategy: ExplorationStrategy = field(default_factory=Optimistic)
    imagined_steps: Count | None = None
    horizon: Count | Sequence[Natural] | None = None
    start_states: Mapping[str, NotNegative] | None = None
    real_data_fraction: Fraction = 0.0
    stale_fraction: Fraction = 0.0
    uncertainty_cap: Positive | None = None
    standardise: bool = True

    def __post_init__(self) -> None:
        if self.horizon is not None:
            HorizonSchedule.read(self.horizon)
        if self.start_states is not None:
            StartStates.require_weights("start_states", self.start_states)


@validated
@dataclass(frozen=True)
class ModelSettings:
    """
    What is learned, and what is known.

    :param dynamics: name of a dynamics model, or a model
    :param dynamics_kwargs: arguments of the named model
    :param task: a task, the place to import one from, ``"learned"``, or None for the one registered with the
        environment's id
    :param task_kwargs: arguments of an imported or learned task
    :raises ValueError: if the name of the model is unknown, an argument is wrong, or a model or task has arguments
        beside it
    """

    dynamics: str | DynamicsModel = "ensemble"
    dynamics_kwargs: Mapping[str, Any] | None = None
    task: Task | str | None = None
    task_kwargs: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        if isinstance(self.dynamics, str):
            with within("dynamics_kwargs"):
                require_arguments(self.dynamics_kwargs or {}, DYNAMICS.resolve(self.dynamics), reserved=NOT_FOR_USERS)
        elif self.dynamics_kwargs:
            raise ArgumentError.of_value(
                "dynamics_kwargs",
                self.dynamics_kwargs,
                "them to the model itself, or name the model, such as 'ensemble'",
            )
        require_task_arguments(self.task, self.task_kwargs or {})


@validated
@dataclass(frozen=True)
class Settings:
    """
    All settings of the outer loop.

    :param real: real episodes
    :param search: policy search in imagination
    :param model: dynamics model and task
    :param planning: planning of real episodes; None for none
    """

    real: RealSettings = field(default_factory=RealSettings)
    search: SearchSettings = field(default_factory=SearchSettings)
    model: ModelSettings = field(default_factory=ModelSettings)
    planning: PlanningSettings | None = None
