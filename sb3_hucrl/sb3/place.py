"""Where a callback stands among the callbacks of a training."""

from __future__ import annotations

from collections.abc import Iterator

from stable_baselines3.common.callbacks import BaseCallback, CallbackList, EvalCallback, EventCallback

from sb3_hucrl.wrappers.imagination import imagination_layer


def require_place(callback: BaseCallback, kind: type[BaseCallback]) -> None:
    """
    Check at the start of a training that a callback sees all of it, and shares it with none of its kind.

    :param callback: in training
    :param kind: of callback of which there may be one
    :raises ValueError: if it is inside a callback that calls it only now and then, there are two, or another callback
        evaluates in the environments that imagine
    """
    if isinstance(callback.parent, EventCallback):
        event = type(callback.parent).__name__
        raise ValueError(
            f"{kind.__name__} is inside {event}, which calls it only now and then, so that it could play no real "
            f"episode: put it beside, callback=[{kind.__name__}(), {event}(...)]"
        )
    beside = all_callbacks(callback)
    count = sum(isinstance(each, kind) for each in beside)
    if count > 1:
        raise ValueError(
            f"there are {count} {kind.__name__}s in this training, and each would play real episodes and "
            "replace what the other imagines: give learn() one of them"
        )
    for each in beside:
        if isinstance(each, EvalCallback):
            _require_own_environment(each)


def all_callbacks(callback: BaseCallback) -> list[BaseCallback]:
    """
    :param callback: in training
    :return: those of the training, itself included, in the order in which SB3 calls them
    """
    # Which of the variables of learn() holds all callbacks differs between algorithms.
    held = {id(value): value for value in callback.locals.values() if isinstance(value, BaseCallback)}
    return [each for value in held.values() for each in _all_within(value)]


def _require_own_environment(evaluation: EvalCallback) -> None:
    imagined, _ = imagination_layer(evaluation.training_env)
    evaluated, _ = imagination_layer(evaluation.eval_env)
    if evaluated is not None and evaluated is imagined:
        raise ValueError(
            f"{type(evaluation).__name__} evaluates in the environments of the training, which are imagined: it "
            "would report imagined returns and end the trajectories of the search: give it real ones of its own, "
            "EvalCallback(make_vec_env(...))"
        )


def _all_within(callback: BaseCallback) -> Iterator[BaseCallback]:
    yield callback
    if isinstance(callback, CallbackList):
        for each in callback.callbacks:
            yield from _all_within(each)
    elif isinstance(callback, EventCallback) and callback.callback is not None:
        yield from _all_within(callback.callback)
