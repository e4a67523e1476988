"""A video of a run's policy."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
import torch as th

from sb3_hucrl.imagination import BatchActor
from sb3_hucrl.progress import PhaseBar
from sb3_hucrl.sb3 import policy_actor
from sb3_hucrl.wrappers import LearnedModelEnv
from sb3_hucrl.zoo.runs import ZooRun

Frame = npt.NDArray[np.uint8]
#: of environments that do not say how many frames a second has
FPS = 30


def record_video(run: ZooRun, video: Path, every: int, seed: int) -> bool:
    """
    The real environment on the left and, where it can be put into a state, what the run's model imagines from where
    real episodes begin on the right.

    :param run: with a policy, or a planner
    :param video: is written, as .mp4 or .gif
    :param every: keep one of so many frames
    :param seed: of the episodes
    :return: whether the imagined episode is in it
    :raises ValueError: if the environment draws no pictures
    """
    import imageio.v3 as iio  # late, because a plot needs none of it

    real_env = run.real_env()
    if "rgb_array" not in real_env.metadata.get("render_modes", ()):
        raise ValueError(f"{run.env_id} cannot be recorded: it has no render mode 'rgb_array'")
    shown = _can_be_placed(real_env)
    columns = {"real": real_frames(run, seed)}
    if shown:
        columns["imagined"] = imagined_frames(run, seed)
    frames = []
    with PhaseBar() as bar:
        bar.begin("frames", None)
        for number, row in enumerate(zip(*columns.values(), strict=False)):
            bar.advance()
            if number % every == 0:
                titled = [
                    _titled(frame, f"{name}: {total:.1f}") for name, (frame, total) in zip(columns, row, strict=True)
                ]
                frames.append(np.hstack(titled))
    iio.imwrite(video, np.stack(frames), fps=real_env.metadata.get("render_fps", FPS) / every)
    return shown


def real_frames(run: ZooRun, seed: int) -> Iterator[tuple[Frame, float]]:
    """
    :param run: whose policy acts
    :param seed: of the episode
    :return: frames and returns so far of one real episode
    """
    env = run.real_env(render_mode="rgb_array")
    return _frames(env, policy_actor(run.model, deterministic=True), seed, draw=lambda observation: _render(env))


def imagined_frames(run: ZooRun, seed: int) -> Iterator[tuple[Frame, float]]:
    """
    :param run: whose policy acts, and whose model answers
    :param seed: of the episode
    :return: frames and returns so far of one imagined episode, drawn by the real environment put into its states
    """
    world = run.world()
    imagination = LearnedModelEnv(world, run.real_env().observation_space)
    canvas = run.real_env(render_mode="rgb_array")
    canvas.reset(seed=seed)
    place = canvas.get_wrapper_attr("set_state")

    def draw(observation: npt.NDArray[np.float32]) -> Frame:
        place(world.task.state(th.as_tensor(observation)[None])[0])
        return _render(canvas)

    return _frames(imagination, policy_actor(run.model, deterministic=True), seed, draw)


def _can_be_placed(env: gym.Env[Any, Any]) -> bool:
    if not env.has_wrapper_attr("set_state"):
        return False
    # Environments of this package take a state; MuJoCo's of gymnasium take joints, which observations do not have.
    return len(inspect.signature(env.get_wrapper_attr("set_state")).parameters) == 1


def _frames(
    env: gym.Env[Any, Any], act: BatchActor, seed: int, draw: Callable[[npt.NDArray[np.float32]], Frame]
) -> Iterator[tuple[Frame, float]]:
    observation, _ = env.reset(seed=seed)
    yield draw(observation), 0.0
    total, over, first = 0.0, False, np.ones(1, dtype=np.bool_)
    while not over:
        observation, reward, terminated, truncated, _ = env.step(act(observation[np.newaxis], first)[0])
        total, over, first = total + float(reward), terminated or truncated, np.zeros_like(first)
        yield draw(observation), total


def _render(env: Any) -> Frame:
    frame: Frame = env.render()
    return frame


def _titled(frame: Frame, text: str) -> Frame:
    from PIL import Image, ImageDraw

    image = Image.fromarray(frame)
    ImageDraw.Draw(image).text((8, 8), text, fill=(220, 30, 30))
    return np.asarray(image)
