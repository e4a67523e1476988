"""
``python -m sb3_hucrl.record RUN_DIR`` writes a video of a run's policy: the real environment on the left, and on the
right what the run's model imagines from where real episodes begin. Environments that cannot be put into an imagined
state are recorded alone.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from sb3_hucrl.pictures import record_video
from sb3_hucrl.zoo.runs import ZooRun


def main() -> None:
    """Read a run's folder, write the video."""
    parser = argparse.ArgumentParser(prog="python -m sb3_hucrl.record", description=__doc__)
    parser.add_argument("run", type=Path, help="folder of the run, such as logs/sac/HUCRL-Pendulum-v0_1")
    parser.add_argument("--output", type=Path, help="video.mp4 in the run's folder by default; .gif works as well")
    parser.add_argument("--every", type=int, default=2, help="keep one of so many frames")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    output = args.output or args.run / "video.mp4"
    try:
        run = ZooRun(args.run)
        both = record_video(run, output, args.every, args.seed)
    except ValueError as error:
        parser.error(str(error))
    if not both:
        print(f"{run.env_id} cannot be put into an imagined state: this is the real episode alone")
    print(f"Video in {output}")


if __name__ == "__main__":
    main()
