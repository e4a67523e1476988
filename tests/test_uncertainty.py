"""The model's uncertainty along trajectories."""

from pathlib import Path

import pandas as pd
import torch as th

from helpers import TruePendulum, imagination_env, pendulum_dataset, small_callback, small_sac
from sb3_hucrl.dynamics import Predictor
from sb3_hucrl.imagination import epistemic_limit


class SampledPendulum(TruePendulum):
    """Unsure as a whole, where its samples are sure of themselves."""

    def sample_posterior(self, generator: th.Generator, num_samples: int = 1) -> Predictor:
        return TruePendulum()


def test_the_limit_is_learned_from_the_real_transitions() -> None:
    transitions = pendulum_dataset(200).transitions
    limit = epistemic_limit(TruePendulum(epistemic_std=0.2), transitions, multiple=3.0)
    th.testing.assert_close(limit, th.tensor([0.6, 0.6]))


def test_thompson_sampling_is_as_unsure_as_the_model_that_it_samples(tmp_path: Path) -> None:
    callback = small_callback(
        exploration="thompson", dynamics=SampledPendulum(epistemic_std=0.25), log_dir=str(tmp_path)
    )
    small_sac(imagination_env(hallucinate=False)).learn(160, callback=callback)
    progress = pd.read_csv(tmp_path / "progress.csv").dropna(subset=["real/return"])
    assert progress["imagined/epistemic_std"].iloc[1:].tolist() == [0.25, 0.25]
