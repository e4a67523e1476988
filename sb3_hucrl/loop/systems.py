"""The real system, and several copies of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from functools import partial
from typing import Annotated, Any, Protocol, SupportsFloat, TypeAlias, TypeVar, runtime_checkable

from pydantic import Field

from sb3_hucrl.checks import validated
from sb3_hucrl.imagination import Array
from sb3_hucrl.loop.settings import RealSettings
from sb3_hucrl.spaces import TIME_LIMIT

T = TypeVar("T")
#: of a step: observation, reward, terminated, truncated, infos
Outcome: TypeAlias = tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]


@runtime_checkable
class RealSystem(Protocol):
    """The part of gymnasium's interface that real episodes need: any ``gymnasium.Env`` has it."""

    def reset(self) -> tuple[Any, dict[str, Any]]:
        """
        :return: the first observation of an episode, and infos
        """

    def step(self, action: Array, /) -> Outcome:
        """
        :param action: (a, a′), of which the system ignores a′
        :return: observation, reward, terminated, truncated, infos
        """


@runtime_checkable
class LimitedSystem(RealSystem, Protocol):
    """A real system whose time limit can be changed: any ``gymnasium.Env`` within a ``TimeLimit``."""

    def set_wrapper_attr(self, name: str, value: Any) -> Any:
        """
        :param name: of an attribute of a wrapper
        :param value: its new value
        """


Copies: TypeAlias = Annotated[Sequence[RealSystem], Field(min_length=1, description="a list of at least one system")]


@validated
class RealSystems:
    """
    Copies of the real system, in which several episodes are played at once. They are called one after another, in the
    thread of the caller.

    :param copies: at least one
    """

    def __init__(self, copies: Copies) -> None:
        self._copies = list(copies)

    def __len__(self) -> int:
        return len(self._copies)

    @property
    def have_time_limits(self) -> bool:
        """Whether all copies have a time limit that can be changed."""
        return all(isinstance(each, LimitedSystem) for each in self._copies)

    @contextmanager
    def ending_after(self, steps: int, usually: int) -> Iterator[None]:
        """
        :param steps: after which all copies end their episodes within the context
        :param usually: the same, outside of it
        """
        if steps == usually:
            yield
            return
        self._limit(steps)
        try:
            yield
        finally:
            # Ctrl-C ends the processes of copies, too, and must not be hidden by that.
            with suppress(RuntimeError):
                self._limit(usually)

    def _limit(self, steps: int) -> None:
        limited = [each for each in self._copies if isinstance(each, LimitedSystem)]
        self._call([partial(each.set_wrapper_attr, TIME_LIMIT, steps) for each in limited])

    def reset(self, indices: Sequence[int]) -> list[Any]:
        """
        :param indices: of n copies
        :return: the first observation of each
        """
        return [observation for observation, _ in self._call([self._copies[index].reset for index in indices])]

    def step(self, indices: Sequence[int], actions: Array) -> list[Outcome]:
        """
        :param indices: of n copies; the others stay as they are
        :param actions: (a, a′) of each, shape (n, q + h)
        :return: what comes of each, in the order of the indices
        """
        pairs = zip(indices, actions, strict=True)
        return self._call([partial(self._copies[index].step, action) for index, action in pairs])

    def _call(self, calls: Sequence[Callable[[], T]]) -> list[T]:
        return [call() for call in calls]


@validated
class ParallelSystems(RealSystems):
    """
    Copies that are called at the same time, each from a thread of its own. It is for copies in other processes or on
    other machines, for whose answer a thread only waits; an answer must not depend on when the other copies are called.

    :param copies: at least one
    """

    def __init__(self, copies: Copies) -> None:
        super().__init__(copies)
        # It starts a thread only when all others are busy, and none for a single call at a time.
        self._threads = ThreadPoolExecutor(len(self._copies), thread_name_prefix="real system")

    def _call(self, calls: Sequence[Callable[[], T]]) -> list[T]:
        if len(calls) == 1:
            return super()._call(calls)
        futures = [self._threads.submit(call) for call in calls]
        try:
            wait(futures)
        finally:
            # Also after Ctrl-C: an answer that nobody has read would be taken for that to the next call.
            wait(futures)
        return [future.result() for future in futures]


def require_systems(systems: RealSystems | None, settings: RealSettings) -> None:
    """
    :param systems: copies of the real system; None where real episodes are told
    :param settings: of real episodes
    :raises ValueError: if the settings ask for more copies than there are, or real episodes are told and there is no
        number of steps to plan with
    """
    if systems is not None:
        if settings.real_envs > len(systems):
            raise ValueError(
                f"real_envs is {settings.real_envs}, and the number of environments {len(systems)}: make more of them "
                f"(n_envs), or give at most {len(systems)}"
            )
        if settings.real_envs > 1 and not settings.whole_episodes:
            raise ValueError(
                f"whole_episodes is False, and real_envs is {settings.real_envs}: parts of episodes are played in one "
                "environment; leave one of them out"
            )
        if settings.early_time_limit is not None and not systems.have_time_limits:
            raise ValueError(
                f"early_time_limit is {settings.early_time_limit}, and the real system is no gymnasium.Env, whose "
                "TimeLimit could be changed: leave it out"
            )
        return
    if not settings.whole_episodes:
        raise ValueError("whole_episodes is False, and real episodes are told, which come as a whole: leave it out")
    if settings.early_time_limit is not None:
        raise ValueError(
            f"early_time_limit is {settings.early_time_limit}, and real episodes are told: leave it out, and end the "
            "first ones yourself"
        )
    if settings.max_real_steps is None:
        raise ValueError(
            "max_real_steps is None, and real episodes are told: give the number of real steps that you plan; "
            "sampling_fraction and the end of the run depend on it"
        )
    if settings.real_envs > 1:
        raise ValueError(
            f"real_envs is {settings.real_envs}, and real episodes are told: leave it out, and ask() for each episode "
            "of each real system"
        )
