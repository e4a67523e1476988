"""What the policy searches have in common that change how SAC trains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
import torch as th
from stable_baselines3 import SAC

from sb3_hucrl.algorithms.imagined_rollouts import require_no_normalization
from sb3_hucrl.seeding import seeded_generator


class ImaginingSAC(SAC):
    """
    SAC whose training imagines: with a source of randomness of its own, and its entropy coefficient in single steps.

    :param args: of SAC
    :param kwargs: of SAC
    :raises ValueError: with gSDE, whose noise stays for several steps, with VecNormalize, or with an argument of SAC
        that would change nothing
    """

    #: arguments of SAC, with a default of 1, of which the algorithm makes no use
    unused: ClassVar[tuple[str, ...]] = ()

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        for argument in self.unused:
            if kwargs.get(argument, 1) != 1:
                raise ValueError(f"{type(self).__name__} makes no use of {argument}: leave it out")
        if kwargs.get("use_sde"):
            raise ValueError(f"{type(self).__name__} draws each action by itself: leave use_sde out")
        super().__init__(*args, **kwargs)

    def _setup_model(self) -> None:
        require_no_normalization(self)
        super()._setup_model()
        self._generator = seeded_generator(self.seed, self.device)

    def _begin_training(self) -> None:
        self.policy.set_training_mode(True)
        optimizers = [self.actor.optimizer, self.critic.optimizer]
        if self.ent_coef_optimizer is not None:
            optimizers.append(self.ent_coef_optimizer)
        self._update_learning_rate(optimizers)

    def _ent_coef(self) -> th.Tensor:
        return self.ent_coef_tensor if self.log_ent_coef is None else self.log_ent_coef.detach().exp()

    def _train_ent_coef(self, log_prob: th.Tensor) -> None:
        """
        :param log_prob: of actions of the present policy, shape (B,)
        """
        if self.ent_coef_optimizer is None or self.log_ent_coef is None:
            return
        assert isinstance(self.target_entropy, float)  # set up
        self.ent_coef_optimizer.zero_grad()
        (-self.log_ent_coef * (log_prob.detach() + self.target_entropy).mean()).backward()
        self.ent_coef_optimizer.step()

    def _record_means(self, noted: Mapping[str, Sequence[float]]) -> None:
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        for name, values in noted.items():
            self.logger.record(f"train/{name}", float(np.mean(values)))

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "_generator"]
