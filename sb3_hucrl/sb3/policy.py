"""An SB3 algorithm's policy and critic as functions of torch tensors, in the units of the environment."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import torch as th
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.common.vec_env import VecNormalize
from torch import nn
from torch.func import functional_call, vmap

from sb3_hucrl.planning import Bounds
from sb3_hucrl.sb3.normalization import reward_unit
from sb3_hucrl.spaces import require_bounded_box, require_vector_observation


class _Mode(nn.Module):
    """A policy's mode as a module of its own, which ``functional_call`` can give other parameters."""

    def __init__(self, network: BasePolicy) -> None:
        super().__init__()
        self.network = network

    def forward(self, inputs: th.Tensor) -> th.Tensor:
        return self.network._predict(inputs, deterministic=True)


class SB3Policy:
    """
    An SB3 algorithm's policy and critic, as :class:`sb3_hucrl.planning.PlannedPolicy`.

    :param model: SB3 algorithm, whose later gradient steps count too
    :raises ValueError: if its policy is no function of the observation alone, or not in torch
    """

    def __init__(self, model: BaseAlgorithm) -> None:
        policy = model.policy
        if isinstance(policy, RecurrentActorCriticPolicy) or not list(policy.parameters()):
            raise ValueError(
                f"planning cannot start from {type(policy).__name__}: it needs a policy in torch that sees nothing but "
                "the observation; use an algorithm of stable-baselines3 or sb3-contrib with MlpPolicy"
            )
        self._network: BasePolicy = policy
        self._mode = _Mode(policy)
        box = require_bounded_box(policy.action_space)
        self._bounds = Bounds(*(th.as_tensor(limit, device=model.device) for limit in (box.low, box.high)))
        self._normalizer: VecNormalize | None = model.get_vec_normalize_env()
        self._gamma = float(getattr(model, "gamma", 1.0))

    @property
    def gamma(self) -> float:
        """The discount that the critic was trained with; 1 where the algorithm has none."""
        return self._gamma

    def _evaluate(self) -> None:
        # Not every time: it visits every module.
        if self._network.training:
            self._network.set_training_mode(False)

    def _inputs(self, observation: th.Tensor) -> th.Tensor:
        normalizer = self._normalizer
        if normalizer is None or not normalizer.norm_obs:
            return observation
        statistics = normalizer.obs_rms
        assert not isinstance(statistics, dict)  # observations are vectors
        mean, var = (th.as_tensor(moment).to(observation) for moment in (statistics.mean, statistics.var))
        return ((observation - mean) / (var + normalizer.epsilon).sqrt()).clamp(
            -normalizer.clip_obs, normalizer.clip_obs
        )

    def act(self, observation: th.Tensor) -> th.Tensor:
        """
        The mode (π, η).

        :param observation: shape (B, observation dimension)
        :return: (a, a′), within their bounds, shape (B, q + h)
        """
        self._evaluate()
        return self._in_env_units(self._mode(self._inputs(observation)))

    @th.enable_grad()
    def acting_parameters(self) -> dict[str, th.Tensor]:
        """
        :return: what the mode depends on, by name; not the critics, and no standard deviation
        """
        parameters = dict(self._mode.named_parameters())
        box = require_vector_observation(self._network.observation_space)
        inputs = th.zeros(1, *box.shape, device=self._network.device)
        gradients = th.autograd.grad(self._mode(inputs).sum(), list(parameters.values()), allow_unused=True)
        used = [name for name, gradient in zip(parameters, gradients, strict=True) if gradient is not None]
        return {name: parameters[name] for name in used}

    def act_each(self, parameters: dict[str, th.Tensor], observation: th.Tensor) -> th.Tensor:
        """
        The mode of B policies, in one batched call.

        :param parameters: of each, by name, shape (B, shape of the parameter)
        :param observation: of each, shape (B, observation dimension)
        :return: (a, a′), within their bounds, shape (B, q + h)
        """
        self._evaluate()

        def act(own: dict[str, th.Tensor], inputs: th.Tensor) -> th.Tensor:
            action: th.Tensor = functional_call(self._mode, own, (inputs.unsqueeze(0),))
            return action.squeeze(0)

        return self._in_env_units(vmap(act)(parameters, self._inputs(observation)))

    def _in_env_units(self, action: th.Tensor) -> th.Tensor:
        return self._bounds.unscaled(action) if self._network.squash_output else self._bounds.clip(action)

    def value(self) -> Callable[[th.Tensor], th.Tensor]:
        """
        :return: the critic's V(s), or Q(s, π(s), η(s)), of observations (B, observation dimension), shape (B,)
        :raises ValueError: if the algorithm has no critic
        """
        network = self._network
        if isinstance(network, ActorCriticPolicy):
            return lambda observation: self._unscaled(network.predict_values(self._inputs(observation))[:, 0])
        if not hasattr(network, "critic"):
            raise ValueError(
                f"{type(network).__name__} has no critic to bootstrap with: say dyna_mpc: {{bootstrap: false}}"
            )
        return self._q

    def _q(self, observation: th.Tensor) -> th.Tensor:
        network, inputs = self._network, self._inputs(observation)
        self._evaluate()
        # SB3's critics see actions scaled to [-1, 1], which is also what actors of off-policy algorithms return.
        critic = cast("nn.Module", network.critic)
        values = critic(inputs, self._mode(inputs))
        if isinstance(values, th.Tensor):  # TQC's quantiles, shape (B, critics, quantiles)
            return self._unscaled(values.mean(dim=(1, 2)))
        return self._unscaled(th.cat(values, dim=1).amin(dim=1))

    def _unscaled(self, values: th.Tensor) -> th.Tensor:
        return values * reward_unit(self._normalizer)
