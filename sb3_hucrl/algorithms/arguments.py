"""What arguments may be that SB3's algorithms have."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

import gymnasium as gym
from pydantic import Field
from stable_baselines3.common.vec_env import VecEnv

from sb3_hucrl.checks import Count

#: None where load() makes the algorithm
Environment: TypeAlias = gym.Env[Any, Any] | VecEnv | str | None
GradientSteps: TypeAlias = Annotated[
    int, Field(ge=-1, description="an integer of at least 0, or -1 for as many as there were steps")
]
TrainFrequency: TypeAlias = Count | tuple[Count, Literal["step", "episode"]]
