"""
Every public argument is given what it must not get. Arguments are found by looking, so that a new one is covered
without anyone thinking of it. The number of cases is printed at the end of the run.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import pytest
import torch as th

import fuzzing
from helpers import imagination_env, small_callback, small_sac, state_of
from sb3_hucrl import HUCRLCallback
from sb3_hucrl.checks import arguments_of
from sb3_hucrl.dynamics import DYNAMICS
from sb3_hucrl.exploration import STRATEGIES
from sb3_hucrl.loop.settings import NOT_FOR_USERS
from sb3_hucrl.planning import PLANNERS, DynaMPCSettings, HMPCSettings

pytestmark = pytest.mark.slow

TARGETS = fuzzing.public_targets()
#: required arguments of what passes unknown ones on
EXAMPLES: dict[str, Any] = {
    "state_dim": 2,
    "action_dim": 1,
    "angle_dims": (),
    "generator": th.Generator(),
    "policy": "MlpPolicy",
    "env": None,
    "env_id": "HUCRL-Pendulum-v0",
    "planner": "cem",
}
NAMES = {"make_dynamics": {"name": "ensemble"}, "make_planner": {"name": "cem"}, "make_strategy": {"name": "greedy"}}
Recorder = Callable[[str, object], None]
every_target = pytest.mark.parametrize("target", TARGETS.values(), ids=TARGETS.keys())


def fault_of(call: Callable[[], object], said: str) -> str | None:
    """What is wrong with how a bad argument is refused; None if nothing is."""
    try:
        call()
    except (ValueError, TypeError) as error:
        return None if said in str(error) else f"is refused by {type(error).__name__}: {error}"
    except Exception as error:  # whatever it is, it says nothing of the argument
        return f"ends in {type(error).__name__}: {error}"
    return "is accepted"


def bad_values(target: Callable[..., Any]) -> list[tuple[str, Any]]:
    """Arguments of a class or function, with values that they must not have."""
    return [
        (name, value)
        for function in fuzzing.functions_of(target)
        for name, annotation in fuzzing.annotations_of(function).items()
        for value in fuzzing.VALUES
        if not fuzzing.allows(annotation, value)
    ]


@every_target
def test_every_bad_value_is_refused_by_name(target: Callable[..., Any], record_property: Recorder) -> None:
    call = fuzzing.callable_of(target)
    cases = bad_values(target)
    faults = [(name, value, fault_of(partial(call, **{name: value}), f"{name} is")) for name, value in cases]
    record_property("fuzz_cases", len(cases))
    assert [each for each in faults if each[2]] == []


def test_a_forgotten_check_is_found() -> None:
    def careless(count: int) -> int:
        return count // 1

    assert fault_of(partial(careless, count=-1), "count is") == "is accepted"
    assert fault_of(lambda: math.sqrt("no"), "count is") is not None  # type: ignore[arg-type]  # the point of it


@every_target
def test_an_unknown_argument_is_refused_by_name(target: Callable[..., Any], record_property: Recorder) -> None:
    arguments = arguments_of(target)
    # What a twin does not know is for the original.
    if inspect.isabstract(target) or not arguments or target.__qualname__ == "Twin.__call__":
        return
    examples = EXAMPLES | NAMES.get(target.__name__, {})
    required = [name for name, one in arguments.items() if one.default is one.empty and name in examples]
    given = {name: examples[name] for name in required}
    record_property("fuzz_cases", 1)
    assert fault_of(partial(fuzzing.callable_of(target), no_such_argument=1, **given), "no_such_argument") is None


@every_target
def test_every_number_states_its_range(target: Callable[..., Any]) -> None:
    for function in fuzzing.functions_of(target):
        assert [name for name, hint in fuzzing.annotations_of(function).items() if fuzzing.bare_numbers(hint)] == []


@dataclass(frozen=True)
class Inner:
    """
    Arguments in a mapping that the callback is given.

    :param argument: the mapping
    :param beside: other arguments of the callback
    :param targets: what its contents are for
    :param reserved: arguments of these that are not for the user
    """

    argument: str
    beside: dict[str, Any]
    targets: tuple[Callable[..., Any], ...]
    reserved: tuple[str, ...] = ()


INNER = [
    *[Inner("exploration_kwargs", {"exploration": name}, (STRATEGIES.resolve(name),)) for name in STRATEGIES],
    *[Inner("dynamics_kwargs", {"dynamics": name}, (DYNAMICS.resolve(name),), NOT_FOR_USERS) for name in DYNAMICS],
    *[
        Inner("planner_kwargs", {"planner": name}, (HMPCSettings, PLANNERS.resolve(name)), ("planner",))
        for name in PLANNERS
    ],
    Inner("dyna_mpc", {}, (DynaMPCSettings, PLANNERS.resolve("cem")), ("num_particles",)),
]


@pytest.mark.parametrize("inner", INNER, ids=lambda inner: "-".join([inner.argument, *inner.beside.values()]))
def test_a_bad_value_in_a_mapping_is_refused_with_its_path(inner: Inner, record_property: Recorder) -> None:
    cases = [case for target in inner.targets for case in bad_values(target) if case[0] not in inner.reserved]
    cases += [(name, 1) for name in ("no_such_argument", *inner.reserved)]
    faults = []
    for name, value in cases:
        settings: dict[str, Any] = {**inner.beside, inner.argument: {name: value}}
        # The name of a planner is looked up, as everywhere.
        said = "planner" if name == "planner" else f"{inner.argument}.{name} is"
        faults.append((name, value, fault_of(partial(HUCRLCallback, **settings), said)))
    record_property("fuzz_cases", len(cases))
    assert [each for each in faults if each[2]] == []


@pytest.mark.parametrize(
    "settings",
    [
        {"horizon": 1, "exploration_kwargs": {"beta": 0}},
        {"sampling_fraction": 0, "real_data_fraction": 0, "stale_fraction": 0},
        {"sampling_fraction": 1, "real_data_fraction": 1, "stale_fraction": 1},
        {"planner": "random_shooting", "planner_kwargs": {"horizon": 1, "num_particles": 1, "noise_exponent": 0}},
        {"start_states": {"initial": 1, "visited": 0}, "uncertainty_cap": 1e-9, "max_real_steps": 1},
    ],
    ids=["none of the future", "nothing", "everything", "one plan", "one step"],
)
def test_the_edges_of_what_is_allowed_train(settings: dict[str, Any]) -> None:
    model = small_sac(imagination_env(max_episode_steps=20))
    model.learn(160, callback=small_callback(**settings))
    assert state_of(model).real_episodes >= 1
