"""Where imagined trajectories begin."""

from __future__ import annotations

from collections.abc import Mapping

import torch as th
from gymnasium import spaces

from sb3_hucrl.checks import ArgumentError, NotNegative, SignatureError, did_you_mean, validated
from sb3_hucrl.data import TransitionDataset
from sb3_hucrl.tasks.base import Task

#: how far inflated states reach beyond the visited ones, at least and at most, in standard deviations of these
INFLATION = (2.0, 20.0)
#: number of visited states up to which inflated ones weigh as much; with more they weigh less
FEW_VISITED = 1_000


@validated
class StartStates:
    """
    A mixture of start distributions (appendix C.1: 'any exploratory distribution').

    - ``initial``: where real episodes began,
    - ``visited``: any real state so far,
    - ``inflated``: a visited state + k · (the visited states' standard deviation) · standard normal noise, with k
      between 2 and 20, uniform in its logarithm: a first random episode may have seen a small part of what there is.
      It needs no knowledge of the task, stays within the bounds of the observations, if they have any, and may be out
      of reach, such as a fingertip that is not where the joints put it,
    - ``exploratory``: the task's own distribution, where it has one.

    :param dataset: the real transitions; those appended later count too
    :param task: has the exploratory states
    :param weights: relative weight of each kind; by default all kinds that the task allows weigh the same, but see
        :meth:`trusting`
    :param observation_space: bounds of inflated states; None for none
    :raises ValueError: if a kind is unknown or impossible, a weight negative, or no weight positive
    """

    KINDS = ("initial", "visited", "inflated", "exploratory")

    def __init__(
        self,
        dataset: TransitionDataset,
        task: Task,
        weights: Mapping[str, NotNegative] | None = None,
        observation_space: spaces.Box | None = None,
    ) -> None:
        explores = task.exploratory_states(1, None) is not None
        self._given = weights is not None
        if weights is None:
            weights = dict.fromkeys(self.KINDS if explores else self.KINDS[:-1], 1.0)
        self.require_weights("weights", weights)
        if weights.get("exploratory", 0) > 0 and not explores:
            raise ValueError(
                f"{type(task).__name__} has no exploratory states: use 'inflated' instead, or override "
                "Task.exploratory_states"
            )
        self._dataset = dataset
        self._task = task
        self._space = observation_space
        self._measured, self._visited_spread = 0, th.empty(0)
        self._weights = th.tensor([float(weights.get(kind, 0.0)) for kind in self.KINDS])

    @classmethod
    def require_weights(cls, argument: str, weights: Mapping[str, float]) -> None:
        """
        :param argument: what the weights are called
        :param weights: none below 0
        :raises ValueError: if a kind is unknown, or no weight positive
        """
        for kind in weights:
            if kind not in cls.KINDS:
                similar = did_you_mean(kind, cls.KINDS)
                raise SignatureError(f"{argument}.{kind}", f"is no kind of start states{similar}: give {cls.KINDS}")
        if sum(weights.values()) <= 0:
            raise ArgumentError.of_value(argument, dict(weights), "at least one weight above 0")

    def trusting(self, share: float) -> StartStates:
        """
        The same where weights were given. By default, the less of an episode can be imagined, the more trajectories
        begin in visited states: elsewhere such a model knows little, and from the first states it would not get far.
        And the more has been visited, the fewer begin in inflated states: many of these are out of reach, and what is
        learned for them is at the expense of the others.

        :param share: of an episode that can be imagined, in (0, 1]
        """
        if self._given:
            return self
        weights = {kind: float(weight) for kind, weight in zip(self.KINDS, share * self._weights, strict=True)}
        weights["inflated"] *= min(1.0, FEW_VISITED / max(1, len(self._dataset)))
        return StartStates(self._dataset, self._task, {**weights, "visited": 1.0}, self._space)

    @property
    def unvisited(self) -> float:
        """How many trajectories begin elsewhere for each that begins in a visited state, at most 1."""
        weights = dict(zip(self.KINDS, self._weights.tolist(), strict=True))
        elsewhere = weights["inflated"] + weights["exploratory"]
        return 1.0 if elsewhere >= weights["visited"] else elsewhere / weights["visited"]

    def only(self, kind: str) -> StartStates:
        """
        :param kind: one of :attr:`KINDS`
        :return: start states of this kind alone
        """
        return StartStates(self._dataset, self._task, {kind: 1.0}, self._space)

    def sample(self, n: int, generator: th.Generator | None) -> tuple[th.Tensor, th.Tensor]:
        """
        :param n: how many
        :param generator: draws them, on the CPU
        :return: states, shape (n, p + c), and which of them are initial ones, shape (n,)
        :raises ValueError: if there are no real transitions yet
        """
        if len(self._dataset) == 0:
            raise ValueError("imagination starts from real states, and there are none yet: append a real episode first")
        kinds = th.multinomial(self._weights, n, replacement=True, generator=generator)
        states = th.empty(n, self._dataset.state_dim)
        for index, kind in enumerate(self.KINDS):
            chosen = kinds == index
            count = int(chosen.sum())
            if count:
                states[chosen] = self._draw(kind, count, generator)
        contexts = self._task.sample_contexts(n, generator)
        if contexts is not None:
            states[:, self._task.state_dim :] = contexts
        return states, kinds == self.KINDS.index("initial")

    def _draw(self, kind: str, n: int, generator: th.Generator | None) -> th.Tensor:
        if kind == "exploratory":
            states = self._task.exploratory_states(n, generator)
            assert states is not None  # checked in the constructor
            return states
        pool = self._dataset.initial_states if kind == "initial" else self._dataset.transitions.states
        states = pool[th.randint(len(pool), (n,), generator=generator)]
        return self._inflated(states, pool, generator) if kind == "inflated" else states

    def _inflated(self, states: th.Tensor, visited: th.Tensor, generator: th.Generator | None) -> th.Tensor:
        task = self._task
        least, most = INFLATION
        scale = least * (most / least) ** th.rand(len(states), 1, generator=generator)
        states = states + scale * self._spread(visited) * th.randn(states.shape, generator=generator)
        if self._space is None:
            return states
        bounds = (th.as_tensor(limit, dtype=states.dtype) for limit in (self._space.low, self._space.high))
        return task.state(task.observe(states).clamp(*bounds))

    def _spread(self, visited: th.Tensor) -> th.Tensor:
        # Trajectories may end in every step, and there may be many real ones.
        if len(visited) != self._measured:
            task = self._task
            spread = visited.std(dim=0, correction=0)
            # A goal that no episode has is not a state further out.
            spread[task.state_dim :] = 0.0
            if task.carries_constants:
                observed = task.state_dim - task.outcome_dim
                spread[:observed] *= ~self._dataset.constant_dims(observed)
            self._measured, self._visited_spread = len(visited), spread
        return self._visited_spread
