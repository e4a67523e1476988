"""Why a run of the suite did not learn, as ``python -m sb3_hucrl.diagnose`` says it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def diagnosis_of(run: Path) -> str:
    """
    :param run: folder of rl_zoo3's run
    :return: the most likely cause and the setting to change first, in one line; what went wrong if there is none
    """
    # A process of its own, as two may be diagnosed at once, and on one thread as the training was.
    process = subprocess.run(
        [sys.executable, "-m", "sb3_hucrl.diagnose", str(run)],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    )
    if process.returncode != 0:
        lines = process.stderr.strip().splitlines() or [f"exit status {process.returncode}"]
        return f"Not diagnosed: {lines[-1]}"
    return first_paragraph(process.stdout)


def first_paragraph(text: str) -> str:
    """
    :param text: of a console, which breaks long lines; a diagnosis has its answer before the first empty line
    :return: the first paragraph, in one line
    """
    paragraph, _, _ = text.strip().partition("\n\n")
    return " ".join(paragraph.split())
