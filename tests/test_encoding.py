"""Encoding of states and actions as model inputs."""

import math

import pytest
import torch as th

from sb3_hucrl.dynamics.encoding import StateFeatures


def test_angles_enter_as_sine_and_cosine_and_differences_are_wrapped() -> None:
    features = StateFeatures(3, [1])
    state = th.tensor([[0.5, math.pi - 0.1, -2.0]])
    th.testing.assert_close(features(state), th.tensor([[math.sin(math.pi - 0.1), math.cos(math.pi - 0.1), 0.5, -2.0]]))
    across = th.tensor([[0.5, -math.pi + 0.1, -1.0]])
    th.testing.assert_close(features.difference(across, state), th.tensor([[0.0, 0.2, 1.0]]))


def test_an_angle_outside_the_state_is_an_error() -> None:
    with pytest.raises(ValueError, match=r"angle_dims \[2\] lie outside"):
        StateFeatures(2, [2])
