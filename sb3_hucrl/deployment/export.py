"""Writes a trained policy as a plain SB3 algorithm of the real environment."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch as th
from gymnasium import spaces
from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_hucrl.checks import validated
from sb3_hucrl.deployment.actors import read_actor
from sb3_hucrl.deployment.layers import Dense, Layers, Network, Scaling
from sb3_hucrl.deployment.parts import ActorParts
from sb3_hucrl.deployment.standalone import make_algorithm
from sb3_hucrl.sb3 import Normalization, carried_normalization, get_state, real_steps_in, save_atomically
from sb3_hucrl.spaces import first_dims, require_bounded_box, require_vector_observation

#: number of observations on which both policies must agree, and their range in standard deviations
CHECKED, RANGE = 256, 3.0
#: by how much they may differ, as a fraction of the range of an action
TOLERANCE = 1e-3


@validated
def export(model: BaseAlgorithm, path: str | Path) -> BaseAlgorithm:
    """
    Write the policy alone, for the real environment: from its observations as they are to its actions without a′. The
    zip file needs neither this package nor sb3-contrib or SBX. ``SAC.load`` of stable_baselines3 opens what was trained
    with SAC, TQC, CrossQ, H-SVG, H-BPTT or H-MVE; ``PPO.load`` PPO, A2C and TRPO; ``TD3.load`` TD3, DDPG, MPO and
    H-MPO. Of SBX, SAC, TQC, TD3, DDPG and PPO can be exported, of ARS both policies (as TD3, the linear one as PPO).

    Its deterministic actions are those of ``model.predict``. Scales of the observations, those of VecNormalize too, are
    folded into the first layer, which does not clip where VecNormalize does. Everything but the policy is left behind:
    data, dynamics model, critics. To go on training, keep the model's own file.

    :param model: SB3 algorithm that :class:`sb3_hucrl.HUCRLCallback` has trained
    :param path: of the zip file to write, with or without its suffix
    :return: the algorithm in the file
    :raises ValueError: if there is no policy to export or it has parts that stable_baselines3 does not, if the file
        holds a training, which would be lost, or if the exported policy acts differently
    :raises OSError: if the file cannot be written
    """
    state = get_state(model)
    parts = read_actor(model)
    if state is None:
        raise ValueError(
            "the model was not trained with HUCRLCallback, so nothing says which of its actions are real; "
            "model.save(path) writes it as it is"
        )
    file = _free(Path(path))
    normalization = carried_normalization(model)
    observations = require_vector_observation(model.observation_space)
    actions = first_dims(require_bounded_box(model.action_space), state.dataset.action_dim)
    exported = _without_hallucination(parts, normalization, observations, actions)
    _require_the_same(model, normalization, exported)
    save_atomically(exported, file)
    return exported


def _free(path: Path) -> Path:
    file = path if path.suffix else path.with_name(f"{path.name}.zip")
    if file.is_file() and real_steps_in(file):
        raise ValueError(
            f"{file} holds a training with its data, which the exported policy would replace: give another path"
        )
    return file


def _without_hallucination(
    parts: ActorParts, normalization: Normalization | None, observations: spaces.Box, actions: spaces.Box
) -> BaseAlgorithm:
    layers, dim = [*_scale(normalization), *parts.layers], actions.shape[0]
    log_std: Dense | th.Tensor | None = None
    if isinstance(parts.log_std, th.Tensor):
        log_std = parts.log_std[:dim]
    elif parts.log_std is not None:
        log_std = Network.of([*layers, parts.log_std]).first(dim).output
    network = Network.of([*layers, parts.mean]).first(dim)
    return make_algorithm(parts.kind, network, log_std, observations, actions)


def _scale(normalization: Normalization | None) -> Layers:
    if normalization is None or normalization.observations is None:
        return []
    moments, epsilon = normalization.observations, normalization.arguments["epsilon"]
    return [Scaling.standardising(th.as_tensor(moments.mean), th.as_tensor(moments.var + epsilon).sqrt())]


def _require_the_same(model: BaseAlgorithm, normalization: Normalization | None, exported: BaseAlgorithm) -> None:
    """A policy class of the user's own may use its layers in any way: better an error than a policy that errs."""
    space, actions = model.observation_space, exported.action_space
    assert isinstance(space, spaces.Box)  # as required above
    assert isinstance(actions, spaces.Box)  # as above
    z = np.random.default_rng(0).uniform(-RANGE, RANGE, (CHECKED, *space.shape))
    moments = None if normalization is None else normalization.observations
    observations = (z if moments is None else moments.mean + np.sqrt(moments.var) * z).astype(space.dtype)
    inputs = observations if normalization is None else normalization.normalised(observations)
    expected = model.predict(inputs, deterministic=True)[0][:, : actions.shape[0]]
    found = exported.predict(observations, deterministic=True)[0]
    difference = float(np.abs((found - expected) / (actions.high - actions.low)).max())
    if not difference <= TOLERANCE:
        raise ValueError(
            f"the exported policy differs by {difference:.2g} of the range of an action from model.predict(): a policy "
            "class of your own, weights that are not finite, or observations that vary by less than a thousandth of "
            "their mean cannot be exported"
        )
