"""Environments around the real one and around the learned one."""

from sb3_hucrl.wrappers.hallucination import HallucinationWrapper
from sb3_hucrl.wrappers.imagination import ImaginationVecEnv
from sb3_hucrl.wrappers.learned_model import LearnedModelEnv
from sb3_hucrl.wrappers.remote import RemoteEnv

__all__ = ["HallucinationWrapper", "ImaginationVecEnv", "LearnedModelEnv", "RemoteEnv"]
