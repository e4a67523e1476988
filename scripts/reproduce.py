"""
Draws the paper's figures from runs of this package, and prints their main numbers.

Missing runs are made first, with one CSV for each run. Figures share common runs. An interrupted command continues
where it stopped. ``--quick`` checks within minutes that everything works, with runs too short to learn anything.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from figures import FIGURES
from figures.launcher import LAUNCHERS

FIRST_SEED = 51


def main() -> None:
    """Make the missing runs, then draw the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--figure", type=int, nargs="+", choices=list(FIGURES), default=list(FIGURES))
    parser.add_argument("--seeds", type=int, default=5, help=f"number of seeds, from {FIRST_SEED} on")
    parser.add_argument(
        "--quick",
        action="store_true",
        help="one seed, one penalty and very short searches, to check that everything works",
    )
    parser.add_argument("--jobs", type=int, default=2, help="number of parallel runs")
    parser.add_argument(
        "--launcher", choices=list(LAUNCHERS), default="local", help="where to run: on this machine or on a Ray cluster"
    )
    parser.add_argument("--output", type=Path, default=Path("results/figures"), help="folder of the CSVs")
    parser.add_argument("--pictures", type=Path, default=Path("docs/figures"), help="folder of the pictures")
    args = parser.parse_args()
    args.pictures.mkdir(parents=True, exist_ok=True)
    seeds = list(range(FIRST_SEED, FIRST_SEED + (1 if args.quick else args.seeds)))
    errors = []
    for number in args.figure:
        figure = FIGURES[number]
        jobs = figure.jobs(seeds, args.quick)
        errors += LAUNCHERS[args.launcher](jobs, args.output, args.jobs) if jobs else []
        picture = args.pictures / f"figure_{number}{'_quick' if args.quick else ''}.png"
        if not jobs or any(job.path(args.output).exists() for job in jobs):
            numbers = figure.draw(args.output, seeds, args.quick, picture)
            print(picture, numbers, sep="\n", flush=True)
    if errors:
        sys.exit("\n".join(errors))


if __name__ == "__main__":
    main()
