"""What action sequences return in imagination: the objective of every planner."""

from __future__ import annotations

from collections.abc import Callable

import torch as th

from sb3_hucrl.hallucinated_system import HallucinatedSystem

#: V of observations: (B, observation dimension) to (B,)
TerminalValue = Callable[[th.Tensor], th.Tensor]


class ImaginedReturns:
    """
    J of Algorithm 6, lines 3 to 9: Σ_n γ^n r(s_n, a_n) + γ^N V(s_N), all particles of all environments in one batch.

    :param system: in which the sequences are tried
    :param states: where they begin, one for each of B environments, shape (B, p + c)
    :param generator: draws the noise, on the system's device
    :param gamma: γ
    :param terminal_value: V; without it, what follows the horizon counts nothing
    :raises ValueError: if γ is outside (0, 1], or the states have the wrong width
    """

    def __init__(
        self,
        system: HallucinatedSystem,
        states: th.Tensor,
        generator: th.Generator,
        gamma: float = 1.0,
        terminal_value: TerminalValue | None = None,
    ) -> None:
        if not 0 < gamma <= 1:
            raise ValueError(f"gamma is {gamma}: give a discount above 0 and up to 1")
        if states.shape[1:] != (system.task.width,):
            raise ValueError(
                f"states have shape {tuple(states.shape)}, {type(system.task).__name__} needs (B, {system.task.width})"
            )
        self._system = system
        self._states = states
        self._generator = generator
        self._gamma = gamma
        self._terminal_value = terminal_value

    def __call__(self, actions: th.Tensor) -> th.Tensor:
        """
        :param actions: (a, a′), n sequences for each environment, shape (B, n, N, q + h)
        :return: shape (B, n)
        """
        num_envs, n, horizon, dim = actions.shape
        by_step = actions.reshape(num_envs * n, horizon, dim).unbind(dim=1)
        state = self._states.repeat_interleave(n, dim=0)
        total = th.zeros(num_envs * n, device=state.device, dtype=state.dtype)
        discount = th.ones_like(total)
        for action in by_step:
            step = self._system.step(state, action, self._generator)
            total = total + discount * step.total_reward
            # Nothing is earned after the end.
            discount = self._gamma * discount * ~step.terminated
            state = self._system.forget_outcomes(step.next_state)
        if self._terminal_value is not None:
            total = total + discount * self._terminal_value(self._system.task.observe(state))
        return total.view(num_envs, n)
