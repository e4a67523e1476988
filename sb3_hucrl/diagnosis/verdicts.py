"""What the measured numbers mean: pure functions, and thresholds with names."""

from __future__ import annotations

from sb3_hucrl.diagnosis.exploration import ExplorationMeasures
from sb3_hucrl.diagnosis.imagination import LATEST, ImaginationMeasures
from sb3_hucrl.diagnosis.model import ModelMeasures, worst
from sb3_hucrl.diagnosis.search import SearchMeasures
from sb3_hucrl.diagnosis.setup import (
    Setup,
    calmer_values,
    faster_values,
    less_hope,
    longer_search,
    more_hope,
    more_members,
    stronger_model,
)
from sb3_hucrl.diagnosis.verdict import Level, Verdict
from sb3_hucrl.imagination.accuracy import POOR_R2, middle

#: fraction of the errors within 2 standard deviations below which a model is overconfident (0.95 is right)
OVERCONFIDENT = 0.8
#: fraction of the errors within 1 standard deviation above which a model is too careful (0.68 is right)
TOO_CAREFUL = 0.9
#: gap between imagined and real return from which a promise is broken
BROKEN_PROMISE = 0.5
#: fraction of the promised return that is gone without hallucination, from which optimism made it
MADE_BY_OPTIMISM = 0.5
#: fraction of the trajectories that end early from which a search sees too little
CUT_SHORT = 0.5
#: gain over chance and doing nothing below which a search has found nothing
NO_GAIN = 0.1
#: mean size of the actions below which a policy does nothing
IDLE = 0.1
#: fraction of saturated actions from which a policy can hardly change
SATURATED_POLICY = 0.9
#: difference of the critic and what is earned from which its values are not to be believed
WRONG_VALUE = 0.5
#: multiple of what the largest reward could ever earn, from which on a critic has diverged
DIVERGED = 2.0
#: multiple of the usual reward from which on an entropy coefficient has run away
RUNAWAY = 10.0
#: of the usual reward, an entropy coefficient that leaves the task in charge
CALM = 0.1
#: fraction of new cells below which an episode shows nothing new
NOTHING_NEW = 0.02
#: fraction of the way from the worst to the best return so far above which the latest episodes are good ones
NEAR_THE_BEST = 0.5
#: real episodes from which on there is something to diagnose
ENOUGH_EPISODES = 3
#: with fewer, more random episodes are the first thing to try
FEW_EPISODES = 5


def judge_one_step(model: ModelMeasures, setup: Setup) -> Verdict:
    """Whether the model predicts the next state at all."""
    latest = model.latest
    if latest is None:
        return Verdict(Level.NOTE, "There is one real episode, so that no prediction of a new one can be judged.")
    unseen, fitted, dim = middle(latest.r2), middle(model.fitted_r2), worst(latest.r2)
    # First: where nothing happens any more, a new episode is easy to predict.
    if fitted < POOR_R2:
        return Verdict(
            Level.CAUSE,
            f"The model does not predict the next state even of its own data (R² {fitted:.2f}): it is too small or "
            "trained too little, or the next state does not follow from what is observed.",
            stronger_model(setup),
        )
    if unseen < POOR_R2:
        return Verdict(
            Level.CAUSE,
            f"The model predicts the next state of its own data (R² {fitted:.2f}) and not of a new episode "
            f"({unseen:.2f}, {model.names[dim]} is the worst): {setup.real_episodes} real episodes are too few.",
            ("hucrl_initial_episodes:5", "hucrl_real_episodes:2"),
        )
    worst_name = f"{model.names[dim]} is the worst, {float(latest.r2[dim]):.2f}"
    return Verdict(Level.FINE, f"The model predicts the next state of a new episode: R² {unseen:.2f} ({worst_name}).")


def judge_many_steps(
    model: ModelMeasures, imagination: ImaginationMeasures, search: SearchMeasures | None, setup: Setup
) -> Verdict:
    """Whether imagination's horizon is longer than the model can see. A broken promise shows that it matters."""
    latest = model.latest
    if latest is None:
        return Verdict(Level.NOTE, "There is no new episode to predict on and on.")
    trusted, error = latest.trusted_steps, latest.error_after(setup.horizon)
    kept = f"stays near the real states for {trusted} of {len(latest.errors)} steps"
    if trusted >= len(latest.errors):
        return Verdict(Level.FINE, f"Along a new episode the model {kept}.")
    gap = imagination.gap
    if gap is None or gap < BROKEN_PROMISE:
        return Verdict(
            Level.NOTE,
            f"Along a new episode the model {kept}, and does no harm: imagined returns come true. Along an unstable "
            "motion no model does better.",
        )
    more_data = ("hucrl_initial_episodes:5",) if setup.real_episodes <= FEW_EPISODES else ()
    nearer = (f"hucrl_horizon:{max(trusted, 1)}",)
    hope = "optimism over" if setup.strategy == "optimistic" else "imagining"
    return Verdict(
        Level.CAUSE,
        f"Imagination earns what reality does not, because the model is lost before imagination ends: it {kept} (after "
        f"{setup.horizon} they are {error:.1f} standard deviations apart). {setup.real_episodes} real episodes are too "
        f"little data for {hope} {setup.horizon} steps.",
        # A shorter horizon alone leaves the hope: the critic carries it on from step to step.
        (*less_hope(setup), *nearer, *more_data) if _made_by_optimism(search) else (*nearer, *more_data),
    )


def judge_confidence(model: ModelMeasures, setup: Setup) -> Verdict:
    """Whether the model knows how wrong it is."""
    latest = model.latest
    if latest is None:
        return Verdict(Level.NOTE, "There is no new episode to compare the model's confidence with.")
    one, two = latest.coverage
    said = f"{one:.0%} and {two:.0%} of the errors on a new episode lie within 1 and 2 standard deviations"
    if two >= OVERCONFIDENT:
        knows = "is more careful than it needs to be" if one > TOO_CAREFUL else "knows how wrong it is"
        return Verdict(Level.FINE, f"The model {knows}: {said} (68% and 95% are right).")
    return Verdict(
        Level.NOTE,
        f"The model is overconfident: {said} (68% and 95% are right), so that the truth may lie outside of what "
        "optimism tries.",
        ("hucrl_dynamics__recalibrate:True", *more_members(setup)),
    )


def judge_promises(imagination: ImaginationMeasures, search: SearchMeasures | None, setup: Setup) -> Verdict:
    """Whether imagined returns come true, and whether optimism is what breaks them."""
    gap = imagination.gap
    if gap is None:
        return Verdict(Level.NOTE, "Nothing was imagined before a real episode: there are no promises to compare.")
    last = imagination.promises[-1]
    said = f"{last.imagined:.1f} imagined and {last.real:.1f} earned in episode {last.episode}"
    if gap < BROKEN_PROMISE:
        return Verdict(Level.FINE, f"Imagined returns come true ({said}).")
    if search is not None and _made_by_optimism(search):
        return Verdict(
            Level.CAUSE,
            f"Imagination earns what reality does not ({said}), and what it earns is hoped for: without hallucination "
            f"the policy would earn {search.unsteered:.1f} in imagination instead of {search.mode:.1f}. Optimism is "
            "wider than this much data can correct.",
            less_hope(setup),
        )
    return Verdict(
        Level.CAUSE,
        f"Imagination earns what reality does not ({said}): the policy exploits the model's mistakes.",
        ("hucrl_uncertainty_cap:2", *more_members(setup)),
    )


def _made_by_optimism(search: SearchMeasures | None) -> bool:
    if search is None:
        return False
    base = max(search.random, search.nothing)
    return search.mode - search.unsteered > MADE_BY_OPTIMISM * abs(search.mode - base)


def judge_ends(imagination: ImaginationMeasures, setup: Setup) -> Verdict:
    """Whether trajectories last long enough to be worth a search."""
    if imagination.capped >= CUT_SHORT:
        return Verdict(
            Level.CAUSE,
            f"The uncertainty cap ends {imagination.capped:.0%} of the imagined trajectories, which last "
            f"{imagination.length:.0f} of {imagination.horizon} steps: the search sees too little.",
            (f"hucrl_uncertainty_cap:{2 * (setup.uncertainty_cap or 1.0):g}",),
        )
    if imagination.terminated - imagination.really_terminated >= CUT_SHORT:
        return Verdict(
            Level.CAUSE,
            f"The task ends {imagination.terminated:.0%} of the imagined trajectories and "
            f"{imagination.really_terminated:.0%} of the real episodes: imagination starts where nothing can be saved, "
            "or leads there.",
            ("hucrl_start_states:\"{'initial': 1, 'visited': 1}\"",),
        )
    return Verdict(Level.FINE, f"Imagined trajectories last {imagination.length:.0f} of {imagination.horizon} steps.")


def judge_gain(search: SearchMeasures, setup: Setup) -> Verdict:
    """Whether the search has found anything."""
    said = f"{search.mode:.1f} in imagination, random actions {search.random:.1f}, doing nothing {search.nothing:.1f}"
    if search.gain >= NO_GAIN:
        return Verdict(Level.FINE, f"The search has found something: its policy earns {said}.")
    if search.value_error >= WRONG_VALUE:
        return Verdict(
            Level.CAUSE,
            f"The search ends before it has found anything: its policy earns {said}, and its critic does not know it.",
            (longer_search(setup), *faster_values(setup)),
        )
    if search.effort < IDLE:
        return Verdict(
            Level.CAUSE,
            f"The policy has given up: it hardly acts ({search.effort:.0%} of the actions' bounds), and earns {said}; "
            "nothing that was imagined pays for the way there.",
            more_hope(setup),
        )
    return Verdict(
        Level.CAUSE,
        f"The search finds nothing in imagination: its policy earns {said}.",
        (longer_search(setup), *faster_values(setup)),
    )


def judge_critic(search: SearchMeasures, setup: Setup) -> Verdict:
    """Whether the critic says what the policy earns."""
    critic = search.critic
    if critic is None:
        return Verdict(Level.NOTE, "The algorithm has no critic that can be asked.")
    if abs(critic.value) > DIVERGED * critic.bound:
        return Verdict(
            Level.CAUSE,
            f"The critic has diverged: it values start states at {critic.value:.3g}, and the largest reward so far, at "
            f"every step, would be worth {critic.bound:.3g}.",
            calmer_values(setup),
        )
    said = f"{critic.value:.1f} of start states, where {critic.earned:.1f} is earned"
    if search.value_error < WRONG_VALUE:
        return Verdict(Level.FINE, f"The critic says what the policy earns: {said}.")
    way = "more than" if critic.value > critic.earned else "less than"
    return Verdict(
        Level.NOTE,
        f"The critic promises {way} the policy earns in imagination ({said}, discounted): the values have not arrived.",
        faster_values(setup),
    )


def judge_entropy(search: SearchMeasures) -> Verdict:
    """Whether the task still matters beside the entropy of the policy."""
    coefficient, usual = search.entropy_coefficient, search.usual_reward
    if coefficient is None or usual == 0 or coefficient < RUNAWAY * usual:
        return Verdict(Level.FINE, "The policy's entropy does not count for more than the rewards.")
    return Verdict(
        Level.CAUSE,
        f"The entropy coefficient has run away: it is {coefficient:.3g}, and the usual real reward {usual:.2g}, so the "
        "search makes actions random and does not care for the task.",
        (f"ent_coef:{CALM * usual:.1g}",),
    )


def judge_actions(search: SearchMeasures) -> Verdict:
    """Whether the policy can still change."""
    if search.saturated < SATURATED_POLICY:
        return Verdict(Level.FINE, f"{search.saturated:.0%} of the policy's actions are at their bounds.")
    return Verdict(
        Level.NOTE,
        f"{search.saturated:.0%} of the policy's actions are at their bounds: their gradients vanish, unless bounds "
        "are what the task asks for.",
        ("learning_rate:3e-4",),
    )


def judge_exploration(exploration: ExplorationMeasures, setup: Setup) -> Verdict:
    """Whether real episodes still show something new."""
    fractions, returns = exploration.new_fractions, exploration.returns
    if len(fractions) <= LATEST:
        return Verdict(Level.FINE, f"{fractions[-1]:.0%} of what the last real episode visited was new.")
    latest = sum(fractions[-LATEST:]) / LATEST
    said = f"{latest:.0%} of what the last {LATEST} real episodes visited was new"
    best, least = max(returns), min(returns)
    if latest >= NOTHING_NEW or sum(returns[-LATEST:]) / LATEST >= least + NEAR_THE_BEST * (best - least):
        return Verdict(Level.FINE, f"{said[0].upper()}{said[1:]}.")
    return Verdict(
        Level.NOTE,
        f"{said[0].upper()}{said[1:]}, and they earn less than earlier ones: the model learns nothing more.",
        more_hope(setup),
    )
