"""What is due next: random real episodes, a refit, a search, or real episodes."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate

from sb3_hucrl.loop.budget import MOST_LOGGED, least_real_steps, search_length
from sb3_hucrl.loop.reward import meets_reward
from sb3_hucrl.loop.schedule import EarlyTimeLimit, RewardSeeking
from sb3_hucrl.loop.settings import Settings
from sb3_hucrl.loop.state import HUCRLState


@dataclass(frozen=True)
class Plan:
    """
    Compares what a run has done with what its settings ask for.

    :param settings: of the run
    :param state: of the run, as it is at the time of each question
    :param episode_length: time limit of a real episode, in steps
    """

    settings: Settings
    state: HUCRLState
    episode_length: int

    @property
    def unseen_steps(self) -> int:
        """Transitions that the model has not been fitted to, logged ones included."""
        return len(self.state.dataset) - self.state.fitted_steps

    def _misses(self, episodes: int, steps: int | None) -> bool:
        """Whether there must be more real episodes, or steps of one, before the next refit."""
        unseen = sum(end > self._fitted for end in accumulate(self.state.dataset.lengths))
        too_few = self.settings.real.whole_episodes and unseen < episodes
        return too_few or self._missing_steps(steps) > 0

    def _missing_steps(self, steps: int | None) -> int:
        return self._budget(steps) - (self.state.real_steps - self._fitted)

    @property
    def _fitted(self) -> int:
        """Real steps that the model has been fitted to."""
        return max(0, self.state.fitted_steps - self.state.dataset.logged_steps)

    @property
    def part(self) -> int | None:
        """
        Number of real steps, at most, until it is time for a refit; None to the end of the episode: where refits wait
        for whole ones, and in the last one.
        """
        real = self.settings.real
        if real.whole_episodes or self.progress >= 1:
            return None
        steps = real.initial_steps if self.state.fitted_steps == 0 else real.real_steps
        missing = self._missing_steps(steps)
        return missing if missing > 0 else self._budget(steps)

    def _budget(self, steps: int | None) -> int:
        """Real steps to play at least, where the settings leave it open: short episodes are no reason for a refit."""
        return least_real_steps(self.episode_length) if steps is None else steps

    @property
    def time_limit(self) -> int:
        """Of a real episode that begins now, in steps."""
        return self._time_limit_at(self.state.real_steps)

    def _time_limit_at(self, real_steps: int) -> int:
        given = self.settings.real.early_time_limit
        if given is None or real_steps >= (early := EarlyTimeLimit.read(given)).until:
            return self.episode_length
        return min(early.steps, self.episode_length)

    @property
    def is_solved(self) -> bool:
        """Whether the latest real episodes, if they had the time limit of the environment, reach the threshold."""
        threshold, state = self.settings.real.reward_threshold, self.state
        if threshold is None or not state.last_return >= threshold:
            return False
        begun = state.real_steps - sum(state.dataset.lengths[-self.settings.real.real_envs :])
        return self._time_limit_at(begun) == self.episode_length

    @property
    def misses_random(self) -> bool:
        """Whether random real episodes must be played: with logged data only where the settings ask for them."""
        real = self.settings.real
        asked = real.initial_episodes is not None or real.initial_steps is not None
        if self.state.fitted_steps > 0 or (self.state.dataset.logged_steps > 0 and not asked):
            return False
        return self._misses(real.initial_episodes or 1, real.initial_steps) or self._seeks_reward

    @property
    def random_hold(self) -> int:
        """For how many steps the actions of the next random episode are held at most."""
        given = self.settings.real.seek_reward
        return RewardSeeking.read(given).hold if given is not None and self._seeks_reward else 1

    @property
    def _seeks_reward(self) -> bool:
        """Whether random episodes are to go on, as they have met no reward. The first one is like any other."""
        given, steps = self.settings.real.seek_reward, self.state.real_steps
        if given is None or steps == 0 or self.progress >= 1:
            return False
        return steps < RewardSeeking.read(given).until and not meets_reward(self.state.dataset.transitions)

    @property
    def misses_real(self) -> bool:
        """
        Whether real episodes with a policy must be played before the next refit. With parts of episodes, once the
        ``max_real_steps`` are used up, only the rest of the present one is.
        """
        if not self.settings.real.whole_episodes and self.progress >= 1:
            return self.state.dataset.under_way > 0
        return self._misses(self.settings.real.real_episodes, self.settings.real.real_steps)

    @property
    def needs_refit(self) -> bool:
        """Whether all real episodes before the next refit are played."""
        return not (self.misses_random if self.state.fitted_steps == 0 else self.misses_real)

    @property
    def is_searched(self) -> bool:
        """Whether there is a policy that was found in the present model, and asked for."""
        found = self.state.asked.found
        return found is not None and found.fitted_steps == self.state.fitted_steps

    @property
    def is_between_episodes(self) -> bool:
        """Whether a search has ended, and some of its real episodes are played, but not all."""
        return self.state.fitted_steps > 0 and self.unseen_steps > 0 and self.misses_real

    @property
    def progress(self) -> float:
        """Fraction of the ``max_real_steps`` that are used up; 0 where there is no such number."""
        return self._fraction(self.state.real_steps)

    @property
    def next_progress(self) -> float:
        """The same, once the real episodes after the present search are played."""
        real, lengths = self.settings.real, self.state.dataset.lengths
        planned = max([self._budget(real.real_steps), *(real.real_episodes * each for each in lengths[-1:])])
        return self._fraction(self.state.real_steps + planned)

    def _fraction(self, steps: int) -> float:
        most = self.settings.real.max_real_steps
        return 0.0 if most is None else steps / most

    @property
    def new_steps(self) -> int:
        """Transitions that the next refit is the first to see, as far as they make the search after it longer."""
        uncounted = max(0, self.state.dataset.logged_steps - MOST_LOGGED) if self.state.fitted_steps == 0 else 0
        return self.unseen_steps - uncounted

    @property
    def search_steps(self) -> int:
        """Timesteps of a whole search in the present model."""
        if self.settings.search.imagined_steps is not None:
            return self.settings.search.imagined_steps
        new_steps = self.state.new_steps
        if new_steps is None:
            new_steps = max([self._budget(self.settings.real.real_steps), *self.state.dataset.lengths[-1:]])
        return search_length(new_steps)
