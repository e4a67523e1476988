"""What a run has learned is consistent at every moment, and takes little more room than its real transitions."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import pytest
import torch as th
from stable_baselines3.common.env_util import make_vec_env

from helpers import ENV_ID, TruePendulum, random_transitions, small_callback, small_sac, state_of
from sb3_hucrl import HUCRLState, ImaginationVecEnv, TransitionDataset, Transitions
from sb3_hucrl.loop import ImaginedEpisode
from sb3_hucrl.loop.state import KEPT_FIRST, KEPT_LATEST


def state_after(num_episodes: int, length: int = 20) -> HUCRLState:
    """The first episode is random, the others were imagined before."""
    dataset = TransitionDataset(2, 1)
    state = HUCRLState(dataset, TruePendulum(), th.Generator())
    for number in range(1, num_episodes + 1):
        dataset.append_episode(random_transitions(length, number))
        if number > 1:
            state.remember_imagined(ImaginedEpisode(number, random_transitions(length, number)))
    return state


def copy_of(state: HUCRLState) -> HUCRLState:
    copied: HUCRLState = pickle.loads(pickle.dumps(state))
    return copied


def test_every_promise_is_kept_and_few_whole_episodes() -> None:
    state = copy_of(state_after(40))
    assert [each.real_episode for each in state.promised_returns] == list(range(2, 41))
    first, latest = range(2, 2 + KEPT_FIRST), range(41 - KEPT_LATEST, 41)
    assert [each.real_episode for each in state.imagined_episodes] == [*first, *latest]
    whole = state.imagined_episodes[-1].transitions
    assert state.promised_returns[-1].value == pytest.approx(float(whole.rewards.sum()))
    assert state.promised_returns[-1].steps == 20


def test_imagined_episodes_take_no_more_room_in_a_long_run() -> None:
    def room(num_episodes: int) -> int:
        state = state_after(num_episodes)
        transitions = len(pickle.dumps(state.dataset.transitions))
        # SB3 writes each attribute into the zip file once more, as text that people may read.
        texts = sum(len(str(each)) for name, each in vars(state).items() if name != "dataset")
        return len(pickle.dumps(state)) + texts - transitions

    assert room(400) - room(100) < 300 * 250


def test_a_file_with_all_imagined_episodes_keeps_what_is_needed() -> None:
    state = state_after(30)
    saved = state.__getstate__()
    del saved["promised_returns"]
    # Twice before the second, and before one that nobody finished.
    numbers = [2, *range(2, 32)]
    saved |= {"imagined_episodes": [ImaginedEpisode(each, random_transitions(20, each)) for each in numbers]}
    loaded = HUCRLState.__new__(HUCRLState)
    loaded.__setstate__(saved | {"real_episodes": 30})
    assert [each.real_episode for each in loaded.promised_returns] == list(range(2, 31))
    assert len(loaded.imagined_episodes) == KEPT_FIRST + KEPT_LATEST
    assert loaded.real_episodes == 30


class Broken(gym.Wrapper[Any, Any, Any, Any]):
    """Is interrupted at its third reset: SB3 makes the first, and the random real episode the second."""

    episodes = 0

    def reset(self, **kwargs: Any) -> Any:
        self.episodes += 1
        if self.episodes == 3:
            raise KeyboardInterrupt
        return super().reset(**kwargs)


def test_a_promise_is_remembered_with_the_real_episode_that_follows_it() -> None:
    kwargs: dict[str, Any] = {"env_kwargs": {"max_episode_steps": 20}, "wrapper_class": Broken}
    model = small_sac(ImaginationVecEnv(make_vec_env(ENV_ID, 2, seed=0, **kwargs)))
    with pytest.raises(KeyboardInterrupt):
        model.learn(240, callback=small_callback())
    state = state_of(model)
    assert [each.real_episode for each in state.promised_returns] == list(range(2, state.real_episodes + 1))
    model.learn(80, callback=small_callback(), reset_num_timesteps=False)
    assert [each.real_episode for each in state.promised_returns] == list(range(2, state.real_episodes + 1))


def steps_of(dataset: TransitionDataset) -> Iterator[int]:
    yield len(dataset)
    yield sum(dataset.lengths)
    yield len(dataset.train) + int(dataset._is_holdout.sum())
    yield 10 * len(dataset.initial_states)


@pytest.mark.parametrize("at", range(1, 7))
def test_an_interrupted_append_leaves_all_or_nothing(at: int, monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = TransitionDataset(2, 1)
    dataset.append_episode(random_transitions(10))
    calls, cat = 0, th.cat

    def interrupted(*args: Any, **kwargs: Any) -> th.Tensor:
        nonlocal calls
        calls += 1
        if calls == at:
            raise KeyboardInterrupt
        return cat(*args, **kwargs)

    second = random_transitions(10, 1)
    monkeypatch.setattr(th, "cat", interrupted)
    with pytest.raises(KeyboardInterrupt):
        dataset.append_episode(second)
    monkeypatch.undo()
    assert set(steps_of(dataset)) == {10}
    dataset.append_episode(random_transitions(10, 2))
    assert set(steps_of(dataset)) == {20}
    assert isinstance(dataset.episodes[1], Transitions)
