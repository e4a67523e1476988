"""
Two policy searches on eighteen environments, each with its default setting, beside SAC without a model.

On each environment, the same command trains with nothing changed but the environment's id. SAC gets rl_zoo3's own
settings for the environment, and is looked at after the same and after ten times the real steps. Each run writes one
CSV; a run whose CSV exists is skipped, and one that failed has its error there. Table and picture show whatever there
is. ``--quick`` checks within minutes that everything works, with runs too short to learn anything. ``--real-steps``,
with another ``--output``, looks at some environments for longer.
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import replace
from pathlib import Path

from figures.launcher import LAUNCHERS
from suite_parts.picture import draw
from suite_parts.plans import FASTEST, PLANS
from suite_parts.run import SuiteRun
from suite_parts.table import brief_table, diagnoses, put_into, read, table
from suite_parts.tasks import QUICK_STEPS, TASKS

PAGES = [Path("docs/suite.md"), Path("README.md")]


def main() -> None:
    """Make the missing runs, cheap ones first, then write the table and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--envs", nargs="+", choices=[task.env for task in TASKS], metavar="ENV", help="some only")
    parser.add_argument("--seeds", nargs="+", type=int, default=[51, 52, 53])
    parser.add_argument("--who", nargs="+", choices=list(PLANS), default=list(PLANS), help="the sides to run")
    parser.add_argument("--algo", choices=["sac", "sbx_sac"], default=FASTEST, help="searches H-UCRL's policy")
    parser.add_argument("--baseline", choices=["sac", "sbx_sac"], default=FASTEST, help="SAC without a model")
    parser.add_argument("--real-steps", type=int, help="of each run, instead of the environments' own")
    parser.add_argument("--quick", action="store_true", help="very short runs, to check that everything works")
    parser.add_argument("--draw", action="store_true", help="run nothing: table and picture of what there is")
    parser.add_argument("--jobs", type=int, default=2, help="number of parallel runs")
    parser.add_argument(
        "--launcher", choices=list(LAUNCHERS), default="local", help="where to run: on this machine or on a Ray cluster"
    )
    parser.add_argument("--output", type=Path, default=Path("results/suite"), help="folder of the CSVs")
    parser.add_argument("--table", type=Path, nargs="*", default=PAGES, help="pages with its marks")
    parser.add_argument("--picture", type=Path, default=Path("docs/suite.png"))
    args = parser.parse_args()

    tasks = [replace(task, real_steps=QUICK_STEPS) for task in TASKS] if args.quick else list(TASKS)
    if args.real_steps is not None:
        # A study of its own: table and picture are of these environments alone.
        tasks = [
            replace(task, real_steps=args.real_steps) for task in tasks if args.envs is None or task.env in args.envs
        ]
    if args.quick:
        args.output = args.output / "quick"
        args.table, args.picture = [], args.output / "suite.png"
    algos = {"hucrl": args.algo, "hsvg": "hsvg", "baseline": args.baseline}
    # Seed by seed, so that an interrupted suite has whole seeds.
    runs = [
        SuiteRun(task, who, algos[who], seed, args.quick)
        for seed in args.seeds
        for task in sorted(tasks, key=lambda task: task.real_steps)
        if args.envs is None or task.env in args.envs
        for who in args.who
    ]
    errors = [] if args.draw else LAUNCHERS[args.launcher](runs, args.output, args.jobs)
    results = read(args.output, tasks)
    draw(results, tasks, args.picture)
    text = table(results, tasks)
    print(text)
    medians = brief_table(results, tasks)
    for page in args.table:
        picture = f"![Real return against real steps]({os.path.relpath(args.picture, page.parent)})"
        blocks = {"suite": f"{text}\n\n{picture}", "suite in brief": f"{picture}\n\n{medians}"}
        put_into(page, blocks | {"diagnoses": diagnoses(results, tasks)})
    if errors:
        sys.exit("\n".join(errors))


if __name__ == "__main__":
    main()
