"""
``python -m sb3_hucrl.export_run RUN_DIR`` writes the policy of a run of rl_zoo3 as a zip file that stable-baselines3
loads without this package. The policy sees what the real environment observes, and returns its action without a′.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from sb3_hucrl.deployment import export
from sb3_hucrl.zoo.runs import ZooRun


def main() -> None:
    """Read a run's folder, write the policy."""
    parser = argparse.ArgumentParser(prog="python -m sb3_hucrl.export_run", description=__doc__)
    parser.add_argument("run", type=Path, help="folder of the run, such as logs/sac/HUCRL-Pendulum-v0_1")
    parser.add_argument("--output", type=Path, help="policy.zip in the run's folder by default")
    args = parser.parse_args()
    output = args.output or args.run / "policy.zip"
    try:
        exported = export(ZooRun(args.run).model, output)
    except ValueError as error:
        parser.error(str(error))
    print(f"Policy in {output}, for stable_baselines3.{type(exported).__name__}.load")


if __name__ == "__main__":
    main()
