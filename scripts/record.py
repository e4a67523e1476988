"""
Writes a video of a run's policy: the real environment on the left, and on the right what the run's model imagines from
where real episodes begin.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import imageio.v3 as iio
import numpy as np
import numpy.typing as npt
import torch as th
from PIL import Image, ImageDraw
from tqdm import tqdm

from sb3_hucrl import LearnedModelEnv
from sb3_hucrl.loop import Actor, one_by_one
from sb3_hucrl.sb3 import policy_actor
from sb3_hucrl.zoo.runs import ZooRun

Frame = npt.NDArray[np.uint8]


def labelled(frame: Frame, text: str) -> Frame:
    """A frame with a line of text in its corner."""
    image = Image.fromarray(frame)
    ImageDraw.Draw(image).text((8, 8), text, fill=(220, 30, 30))
    return np.asarray(image)


def real_frames(run: ZooRun, act: Actor, seed: int) -> Iterator[tuple[Frame, float]]:
    """Frames and returns so far of one real episode."""
    env = run.real_env(render_mode="rgb_array")
    return _frames(env, act, seed, draw=lambda observation: _render(env))


def imagined_frames(run: ZooRun, act: Actor, seed: int) -> Iterator[tuple[Frame, float]]:
    """Frames and returns so far of one imagined episode, drawn by the real environment put into its states."""
    world = run.world()
    imagination = LearnedModelEnv(world, run.real_env().observation_space)
    canvas = run.real_env(render_mode="rgb_array")
    canvas.reset(seed=seed)
    place = canvas.get_wrapper_attr("set_state")

    def draw(observation: npt.NDArray[np.float32]) -> Frame:
        place(world.task.state(th.as_tensor(observation)[None])[0])
        return _render(canvas)

    return _frames(imagination, act, seed, draw)


def _frames(
    env: gym.Env[Any, Any], act: Actor, seed: int, draw: Callable[[npt.NDArray[np.float32]], Frame]
) -> Iterator[tuple[Frame, float]]:
    observation, _ = env.reset(seed=seed)
    yield draw(observation), 0.0
    total, over, first = 0.0, False, True
    while not over:
        observation, reward, terminated, truncated, _ = env.step(act(observation, first))
        total, over, first = total + float(reward), terminated or truncated, False
        yield draw(observation), total


def _render(env: Any) -> Frame:
    frame: Frame = env.render()
    return frame


def main() -> None:
    """Read a run's folder, write the video."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path, help="folder of the run, such as logs/sac/HUCRL-Pendulum-v0_1")
    parser.add_argument("--output", type=Path, help="video.mp4 in the run's folder by default; .gif works as well")
    parser.add_argument("--every", type=int, default=2, help="keep one of so many frames")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    run, output = ZooRun(args.run), args.output or args.run / "video.mp4"
    env = run.real_env()
    if not env.has_wrapper_attr("set_state"):
        parser.error(f"{run.env_id} cannot be put into an imagined state: only environments of this package can")
    act = one_by_one(policy_actor(run.model, deterministic=True))
    imagined_act = one_by_one(policy_actor(run.model, deterministic=True))
    frames = []
    pairs = zip(real_frames(run, act, args.seed), imagined_frames(run, imagined_act, args.seed), strict=False)
    for number, ((real, real_return), (imagined, imagined_return)) in enumerate(tqdm(pairs, unit="step", disable=None)):
        if number % args.every == 0:
            left = labelled(real, f"real: {real_return:.1f}")
            frames.append(np.hstack([left, labelled(imagined, f"imagined: {imagined_return:.1f}")]))
    fps = env.metadata["render_fps"] / args.every
    iio.imwrite(output, np.stack(frames), fps=fps)
    print(f"Video in {output}")


if __name__ == "__main__":
    main()
