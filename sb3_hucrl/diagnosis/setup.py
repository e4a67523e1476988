"""The settings of a run, and which of them to change for what."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from sb3_hucrl.loop import Settings, search_length
from sb3_hucrl.loop.budget import FEW_STEPS

#: horizon from which on a reward may be too far away for one-step targets
FAR_AWAY = 100
#: timesteps in which most tasks of this package are searched well
LONG_SEARCH = 25_600


@dataclass(frozen=True)
class Replay:
    """
    How fast an off-policy algorithm learns values.

    :param n_steps: of its targets
    :param tau: of its target networks
    :param gradient_steps: at each step of all environments; below 1 for one for each of them
    """

    n_steps: int
    tau: float
    gradient_steps: int


@dataclass(frozen=True)
class Setup:
    """
    The settings that verdicts name.

    :param strategy: name of the exploration
    :param beta: of optimism, where it is a number
    :param dynamics: name of the model
    :param horizon: of imagination
    :param imagined_steps: between real episodes
    :param uncertainty_cap: at which trajectories end
    :param real_episodes: so far
    :param inflated_starts: whether imagination also starts beyond the visited states
    :param sought_reward: whether random episodes that met no reward went on with actions that are held
    :param replay: of an off-policy algorithm; None of others
    :param epochs: that an on-policy algorithm repeats its data for; None of others
    """

    strategy: str
    beta: float | None
    dynamics: str
    horizon: int
    imagined_steps: int
    uncertainty_cap: float | None
    real_episodes: int
    inflated_starts: bool
    sought_reward: bool
    replay: Replay | None
    epochs: int | None


def setup_of(settings: Settings, horizon: int, real_episodes: int, model: BaseAlgorithm) -> Setup:
    """
    :param settings: of the loop
    :param horizon: of imagination
    :param real_episodes: so far
    :param model: SB3 algorithm
    """
    search, dynamics = settings.search, settings.model.dynamics
    strategy: Any = search.strategy
    beta = getattr(strategy, "beta", None)
    return Setup(
        strategy=type(strategy).__name__.lower(),
        beta=float(beta) if isinstance(beta, int | float) else None,
        dynamics=dynamics if isinstance(dynamics, str) else type(dynamics).__name__,
        horizon=horizon,
        imagined_steps=search.imagined_steps or search_length(max(FEW_STEPS, horizon)),
        uncertainty_cap=search.uncertainty_cap,
        real_episodes=real_episodes,
        inflated_starts=search.start_states is None or search.start_states.get("inflated", 0) > 0,
        sought_reward=settings.real.seek_reward is not None,
        replay=_replay_of(model),
        epochs=getattr(model, "n_epochs", None),
    )


def _replay_of(model: BaseAlgorithm) -> Replay | None:
    if not isinstance(model, OffPolicyAlgorithm):
        return None
    # Older versions of SB3 have one-step targets only.
    return Replay(getattr(model, "n_steps", 1), model.tau, model.gradient_steps)


def stronger_model(setup: Setup) -> tuple[str, ...]:
    """
    Of a model that does not learn even its own data.

    :param setup: of the run
    """
    if "ensemble" in setup.dynamics:
        return ("hucrl_dynamics__gradient_steps:2000", "hucrl_dynamics__net_arch:'[200,200]'")
    return ("hucrl_dynamics:\"'ensemble'\"",)


def more_members(setup: Setup) -> tuple[str, ...]:
    """
    Of a model that is too sure of itself.

    :param setup: of the run
    """
    return ("hucrl_dynamics__num_members:10",) if "ensemble" in setup.dynamics else ()


def less_hope(setup: Setup) -> tuple[str, ...]:
    """
    Of a policy that hopes for what is not true.

    :param setup: of the run
    """
    return (f"hucrl_exploration__beta:{(setup.beta or 1.0) / 10:g}",) if setup.strategy == "optimistic" else ()


def calmer_values(setup: Setup) -> tuple[str, ...]:
    """
    Of values that diverge.

    :param setup: of the run
    """
    slow = ("tau:0.005",) if setup.replay is not None and setup.replay.tau > 0.005 else ()
    return (*less_hope(setup), "learning_rate:3e-4", *slow)


def longer_search(setup: Setup) -> str:
    """
    Of a search that has found nothing.

    :param setup: of the run
    """
    return f"hucrl_imagined_steps:{max(2 * setup.imagined_steps, LONG_SEARCH)}"


def more_hope(setup: Setup) -> tuple[str, ...]:
    """
    Of a policy that sees nothing to hope for.

    :param setup: of the run
    """
    # A sparse reward has to be met at least once: in imagination by hope or by the start states, or in reality.
    wider = "hucrl_start_states:\"{'initial': 1, 'visited': 1, 'inflated': 1}\""
    starts = () if setup.inflated_starts else (wider,)
    sought = () if setup.sought_reward else ("hucrl_seek_reward:[50,2000]",)
    if setup.strategy == "optimistic":
        return (f"hucrl_exploration__beta:{3 * (setup.beta or 1.0):g}", *starts, *sought)
    return ("hucrl_exploration:\"'optimistic'\"", *starts, *sought)


def faster_values(setup: Setup) -> tuple[str, ...]:
    """
    Of values that do not arrive.

    :param setup: of the run
    """
    # n-step targets carry a value back over long ways; on-policy algorithms have them anyway.
    replay = setup.replay
    if replay is None:
        return () if setup.epochs is None else (f"n_epochs:{2 * setup.epochs}",)
    far = ("n_steps:8",) if setup.horizon > FAR_AWAY and replay.n_steps < 8 else ()
    fast = ("tau:0.02",) if replay.tau < 0.02 else ()
    more = (f"gradient_steps:{2 * replay.gradient_steps}",) if replay.gradient_steps > 0 else ()
    return (*far, *fast, *more)
