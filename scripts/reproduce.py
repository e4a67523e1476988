"""
Draws figures of the paper again, from runs of this package.

What is missing is run first, one CSV for each run, and figures share the runs that they have in common. An interrupted
command goes on where it was. ``--quick`` shows in minutes that everything works; it learns nothing.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import pandas as pd

from figures import CURVES
from figures.bandit import draw_bandit
from figures.launcher import launch

BANDIT = 5


def reproduce(number: int, seeds: list[int], quick: bool, folder: Path, jobs: int) -> list[str]:
    """
    :param number: of the figure
    :param seeds: of its runs
    :param quick: whether to search next to nothing
    :param folder: of results and pictures
    :param jobs: runs side by side
    :return: what went wrong; the picture shows the rest
    """
    folder.mkdir(parents=True, exist_ok=True)
    picture = folder / f"figure_{number}{'_quick' if quick else ''}.png"
    if number == BANDIT:
        draw_bandit(picture, seeds[0])
        print(picture)
        return []
    figure = CURVES[number]
    experiments = figure.experiments(seeds, quick)
    errors = launch(experiments, folder, jobs)
    paths = [each.path(folder) for each in experiments]
    finished = [pd.read_csv(path) for path in paths if path.exists()]
    if finished:
        figure.draw(pd.concat(finished), picture)
        print(picture)
    return errors


def main() -> None:
    """Run what is missing, then draw."""
    known = [BANDIT, *CURVES]
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--figure", type=int, nargs="+", choices=known, default=known)
    parser.add_argument("--seeds", type=int, default=5, help="how many, from 51 on")
    parser.add_argument("--quick", action="store_true", help="one seed and next to no search")
    parser.add_argument("--jobs", type=int, default=2, help="runs side by side")
    parser.add_argument("--output", type=Path, default=Path("results/figures"))
    args = parser.parse_args()
    seeds = list(range(51, 52 if args.quick else 51 + args.seeds))
    errors = [error for number in args.figure for error in reproduce(number, seeds, args.quick, args.output, args.jobs)]
    if errors:
        sys.exit("\n".join(errors))


if __name__ == "__main__":
    main()
