"""
``python -m sb3_hucrl.diagnose RUN_DIR`` says why a run of rl_zoo3 does not learn: the most likely cause, the first
setting to change, and the numbers behind it, as text and as a picture. The run may be finished, running or killed.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.console import Console

from sb3_hucrl.diagnosis import diagnose, draw_diagnosis, print_diagnosis
from sb3_hucrl.diagnosis.model import MAX_REFITS
from sb3_hucrl.zoo.runs import ZooRun


def main() -> None:
    """Read a run's folder, print the diagnosis, write the picture."""
    parser = argparse.ArgumentParser(prog="python -m sb3_hucrl.diagnose", description=__doc__)
    parser.add_argument("run", type=Path, help="folder of the run, such as logs/sac/HUCRL-Pendulum-v0_1")
    parser.add_argument("--output", type=Path, help="picture; diagnosis.png in the run's folder by default")
    args = parser.parse_args()
    output, console = args.output or args.run / "diagnosis.png", Console(highlight=False)
    try:
        run = ZooRun(args.run)
        with console.status(f"Fitting up to {MAX_REFITS} fresh copies of the model to growing parts of the data"):
            diagnosis = diagnose(run)
    except ValueError as error:
        parser.error(str(error))
    print_diagnosis(diagnosis, console)
    draw_diagnosis(diagnosis, str(args.run), output)
    console.print(
        f"\nThe columns of 'Model' are fresh copies of it, {MAX_REFITS} at most, fitted with the run's settings to the "
        f"episodes before.\nErrors are in standard deviations of the state. Picture: {output}",
        soft_wrap=True,
    )


if __name__ == "__main__":
    main()
