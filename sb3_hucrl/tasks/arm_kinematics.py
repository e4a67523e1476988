"""Forward kinematics of the seven-joint arm, in batched torch."""

from __future__ import annotations

import torch as th

#: offsets along the arm, in m: shoulder pan to lift, upper arm, forearm
SHOULDER, UPPER_ARM, FOREARM = 0.1, 0.4, 0.321


def _rotate(vector: th.Tensor, angle: th.Tensor, axis: int) -> th.Tensor:
    """
    :param vector: shape (B, 3)
    :param angle: in rad, shape (B,)
    :param axis: axis of rotation, 0, 1 or 2; the right-hand rule gives the direction
    """
    first, second = (axis + 1) % 3, (axis + 2) % 3
    sine, cosine = angle.sin(), angle.cos()
    turned = [vector[:, axis]] * 3
    turned[first] = cosine * vector[:, first] - sine * vector[:, second]
    turned[second] = sine * vector[:, first] + cosine * vector[:, second]
    return th.stack(turned, dim=1)


def hand_position(angles: th.Tensor, base: tuple[float, float, float], tool_length: float) -> th.Tensor:
    """
    Position of a point on the hand, computed from the hand back to the shoulder.

    :param angles: shoulder pan and lift, upper-arm roll, elbow flex, forearm roll, wrist flex and roll; in rad,
        shape (B, 7)
    :param base: position of the shoulder, in m
    :param tool_length: distance of the point from the wrist, along the hand, in m
    :return: world coordinates in m, shape (B, 3)
    """
    pan, lift, upper_roll, elbow, forearm_roll, wrist_flex, wrist_roll = angles.unbind(dim=1)

    def along(length: float) -> th.Tensor:
        return angles.new_tensor([length, 0.0, 0.0])

    point = _rotate(along(tool_length).expand(len(angles), 3), wrist_roll, axis=0)
    point = along(FOREARM) + _rotate(point, wrist_flex, axis=1)
    point = along(UPPER_ARM) + _rotate(_rotate(point, forearm_roll, axis=0), elbow, axis=1)
    point = _rotate(_rotate(point, upper_roll, axis=0), lift, axis=1)
    return angles.new_tensor(base) + _rotate(along(SHOULDER) + point, pan, axis=2)
