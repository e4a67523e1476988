"""How long real rounds and searches are where the settings leave it open."""

from __future__ import annotations

from sb3_hucrl.checks import Count, Natural, validated

#: real steps that are worth a refit, where an episode may have fewer
FEW_STEPS = 200
#: timesteps of search for each new real step
IMAGINED_PER_REAL = 64
#: new real steps of a search that short episodes do not shorten
FULL_SEARCH = 400
#: logged steps that a first search grows with: more of them make the model better, and need no longer search
MOST_LOGGED = 1_000


@validated
def least_real_steps(episode_length: Count) -> int:
    """
    Short episodes are no reason for a refit.

    :param episode_length: time limit of a real episode, in steps
    """
    return min(FEW_STEPS, episode_length)


@validated
def search_length(new_steps: Natural) -> int:
    """
    64 timesteps for each new real step, and up to twice as many where there are fewer than 400.

    :param new_steps: real steps since the last search
    :return: timesteps of the next one
    """
    return IMAGINED_PER_REAL * max(new_steps, min(2 * new_steps, FULL_SEARCH))
