"""The environments of the suite, with their real steps and what counts as solved."""

from __future__ import annotations

from dataclasses import dataclass

import gymnasium as gym

from sb3_hucrl.tasks.registry import TWIN_PREFIX

GYMNASIUM = "gymnasium"


@dataclass(frozen=True)
class SuiteTask:
    """
    :param env: id of the environment
    :param real_steps: budget of the run; SAC without a model gets ten times as many as well
    :param solved: mean return that counts as solved
    :param source: where that number comes from: gymnasium's ``reward_threshold``, or why it is ours
    """

    env: str
    real_steps: int
    solved: float
    source: str = GYMNASIUM

    @property
    def twin(self) -> str:
        """Id of the environment with room for a′."""
        return self.env if self.env.startswith(TWIN_PREFIX) else TWIN_PREFIX + self.env

    @property
    def time_limit(self) -> int:
        """Steps of a full-length episode."""
        limit = gym.spec(self.env).max_episode_steps
        assert limit is not None  # all of the suite have one
        return limit


TASKS = (
    SuiteTask("Pendulum-v1", 2_000, -250, "it stays up after one or two swings, from wherever it starts"),
    SuiteTask("MountainCarContinuous-v0", 5_000, 90),
    SuiteTask("InvertedPendulum-v5", 3_000, 950),
    SuiteTask("InvertedDoublePendulum-v5", 10_000, 9_100),
    SuiteTask("Reacher-v5", 5_000, -3.75),
    SuiteTask("Pusher-v5", 5_000, -36, "no action has -53; gymnasium's 0 is out of reach, as every reward is negative"),
    SuiteTask("Swimmer-v5", 5_000, 360),
    SuiteTask("Hopper-v5", 5_000, 3_800),
    SuiteTask("HalfCheetah-v5", 5_000, 4_800),
    SuiteTask("Walker2d-v5", 5_000, 3_800, "that of `Hopper-v5`, which has the same reward"),
    SuiteTask("LunarLanderContinuous-v3", 5_000, 200),
    SuiteTask("BipedalWalker-v3", 5_000, 300),
    SuiteTask("HUCRL-Pendulum-v0", 4_000, 150, "it swings up, and is up for more than a third of the episode"),
    SuiteTask("HUCRL-CartPole-v0", 3_000, 100, "it swings up, and is up for about half of the episode"),
    SuiteTask("HUCRL-Reacher-v0", 3_000, -50, "no action has -180"),
    SuiteTask("HUCRL-SparseReacher-v0", 3_000, 75, "half of what is possible; no action has 0"),
    SuiteTask("HUCRL-Pusher-v0", 3_000, -25, "no action has -32, and -30 in the best of 100 episodes"),
    SuiteTask("HUCRL-HalfCheetah-v0", 5_000, 1_000, "it runs a metre each second more than its actions cost"),
)

#: real steps of each environment with ``--quick``
QUICK_STEPS = 250
