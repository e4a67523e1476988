"""What the loop asks of a policy search, whatever library it comes from."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from sb3_hucrl.imagination import BatchActor


@runtime_checkable
class Search(Protocol):
    """A search for the policy that is best in a :class:`sb3_hucrl.imagination.World`."""

    def actor(self, deterministic: bool) -> BatchActor:
        """
        :param deterministic: whether to play the policy's mode, or to sample it
        :return: the present policy; it acts for one batch, whose size stays
        """

    def planner(self, deterministic: bool) -> BatchActor | None:
        """
        :param deterministic: as above
        :return: plays real episodes instead of the policy; None where nothing is planned
        """

    def parameters(self) -> Any:
        """
        :return: a copy of what the search has found, or None where there is no policy to choose
        """

    def restore(self, parameters: Any) -> None:
        """
        :param parameters: that :meth:`parameters` returned; the search goes on from them
        """

    def diagnostics(self) -> dict[str, float]:
        """
        :return: values to log, by name
        """
