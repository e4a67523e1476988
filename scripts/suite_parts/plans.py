"""What rl_zoo3 is asked for, on either side of the comparison."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import yaml

from sb3_hucrl.tasks.registry import TWIN_PREFIX
from suite_parts.tasks import SuiteTask

#: real steps that SAC without a model gets, for each one of ours
TENFOLD = 10
DEFAULT = "default"
#: timesteps of search for each real step, at most
ENOUGH = 1_000
#: SAC, with a model or without: in JAX it takes a third of the time
FASTEST = "sac" if find_spec("sbx") is None else "sbx_sac"
#: for quick runs, which only check that everything works
QUICK_SEARCH, QUICK_SEARCHES = 640, 3
QUICK_PARAMS = (f"hucrl_imagined_steps:{QUICK_SEARCH}", "hucrl_horizon:10", "hucrl_dynamics__gradient_steps:20")


@dataclass(frozen=True)
class Plan:
    """
    A training run of rl_zoo3.

    :param algo: name of the algorithm
    :param env: id of the environment
    :param timesteps: of the algorithm
    :param entry: hyperparameters
    :param entry_name: their key in the file that they come from
    :param words: further words of the command
    :param real_steps: that end the run before the timesteps do; None for none
    """

    algo: str
    env: str
    timesteps: int
    entry: Mapping[str, Any]
    entry_name: str
    words: tuple[str, ...]
    real_steps: int | None = None

    def command(self, folder: Path, seed: int) -> list[str]:
        """
        Write a file of hyperparameters, whose only entry is this one.

        :param folder: of this file and of rl_zoo3's logs
        :param seed: of the run
        :return: the words of the command
        """
        path = folder / "hyperparameters.yml"
        path.write_text(yaml.safe_dump({self.env: dict(self.entry)}))
        return [
            *(sys.executable, "-m", "sb3_hucrl.zoo", "train", "--algo", self.algo, "--env", self.env),
            *("-n", str(self.timesteps), "--seed", str(seed), "--num-threads", "1"),
            *("-conf", str(path), "-f", str(folder), *self.words),
        ]


def default_entry(algo: str) -> dict[str, Any]:
    """
    :param algo: name of an algorithm for which this package has hyperparameters
    :return: the one setting for all environments
    """
    entry: dict[str, Any] = yaml.safe_load((files("sb3_hucrl.zoo_hyperparams") / f"{algo}.yml").read_text())[DEFAULT]
    return entry


def zoo_entry(env: str) -> tuple[str, dict[str, Any]]:
    """
    :param env: id of an environment, with or without ``HUCRL-``
    :return: rl_zoo3's own entry for SAC on the environment of this name, in its latest version, and its key; rl_zoo3's
        ``default`` where there is none
    """
    entries: dict[str, dict[str, Any]] = yaml.safe_load(
        (files("rl_zoo3") / "hyperparams" / "sac.yml").read_text(encoding="utf-8")
    )
    name = re.escape(re.sub(r"-v\d+$", "", env.removeprefix(TWIN_PREFIX)))
    versions = {int(found[1]): key for key in entries if (found := re.fullmatch(rf"{name}-v(\d+)", key))}
    key = versions[max(versions)] if versions else DEFAULT
    return key, entries[key]


def hucrl(task: SuiteTask, algo: str, quick: bool) -> Plan:
    """
    :param task: the environment
    :param algo: of the policy search
    :param quick: whether to make very short searches, of models that are hardly fitted
    :return: the default setting, whether there is another one for this environment or not
    """
    entry = default_entry(algo)
    # The real episodes are those that the model learns from, and no others are played.
    words: tuple[str, ...] = ("--eval-freq", "-1", "-params")
    if quick:
        return Plan(algo, task.twin, QUICK_SEARCHES * QUICK_SEARCH, entry, DEFAULT, (*words, *QUICK_PARAMS))
    # More than enough: the real steps end the training.
    most = ENOUGH * task.real_steps
    return Plan(
        algo, task.twin, most, entry, DEFAULT, (*words, f"hucrl_max_real_steps:{task.real_steps}"), task.real_steps
    )


def baseline(task: SuiteTask, algo: str, quick: bool) -> Plan:
    """
    :param task: the environment
    :param algo: ``sac``, or ``sbx_sac``
    :param quick: changes nothing: a run is as short as its real steps are few
    :return: SAC on the real environment, with the zoo's own settings
    """
    key, entry = zoo_entry(task.env)
    if entry.get("use_sde"):
        algo = "sac"  # SBX repeats its noise but has no gSDE, so it would ignore log_std_init and use_expln
    words: tuple[str, ...] = ("--eval-freq", str(task.real_steps))
    if task.env.startswith(TWIN_PREFIX):
        words += ("--env-kwargs", "hallucinate:False")
    return Plan(algo, task.env, TENFOLD * task.real_steps, entry, key, words)


#: plans by the name of the side
PLANS: dict[str, Callable[[SuiteTask, str, bool], Plan]] = {"hucrl": hucrl, "hsvg": hucrl, "baseline": baseline}
