"""
``python -m sb3_hucrl.plot_run RUN_DIR`` draws what a run of rl_zoo3 has logged, and for the pendulum its real and
imagined trajectories in phase space (figures 12 to 14 of the paper).
"""

from __future__ import annotations

import argparse
from pathlib import Path

from sb3_hucrl.pictures import draw_phase_space, draw_progress, trajectories
from sb3_hucrl.zoo.runs import ZooRun


def main() -> None:
    """Read a run's folder, write the pictures."""
    parser = argparse.ArgumentParser(prog="python -m sb3_hucrl.plot_run", description=__doc__)
    parser.add_argument("run", type=Path, help="folder of the run, such as logs/sac/HUCRL-Pendulum-v0_1")
    parser.add_argument("--output", type=Path, help="folder for the pictures; by default the run's own")
    args = parser.parse_args()
    try:
        run, output = ZooRun(args.run), args.output or args.run
        output.mkdir(parents=True, exist_ok=True)
        draw_progress(run, output / "progress.png")
        if run.env_id == "HUCRL-Pendulum-v0":
            draw_phase_space(trajectories(run.state), str(run.folder), output / "phase_space.png")
    except ValueError as error:
        parser.error(str(error))
    print(f"Pictures in {output}")


if __name__ == "__main__":
    main()
