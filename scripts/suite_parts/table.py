"""The table of the suite, in Markdown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

from suite_parts.measure import failed, final_return, first_solved
from suite_parts.plans import TENFOLD
from suite_parts.tasks import GYMNASIUM, SuiteTask

BEGIN, END = "<!-- suite -->", "<!-- end of suite -->"
HEADER = (
    "environment",
    "real steps",
    "solved at",
    "H-UCRL",
    "first solved, each seed",
    "SAC, same steps",
    "SAC, ten times the steps",
    "verdict",
)
Verdict = Literal["solved", "better than SAC at 10x", "fails", "not solved", "not run"]


def read(folder: Path, tasks: Sequence[SuiteTask]) -> pd.DataFrame:
    """
    :param folder: of the CSVs
    :param tasks: the environments
    :return: the rows of all runs on these
    """
    paths = sorted(folder.glob("*/*.csv"))
    rows = [pd.DataFrame(columns=["who", "env", "seed"]), *(pd.read_csv(path) for path in paths)]
    results = pd.concat(rows[1:] or rows)
    return results[results.env.isin([task.env for task in tasks])]


@dataclass(frozen=True)
class Line:
    """
    One environment. Each number is of one run, in the order of the seeds; a failed run has minus infinity.

    :param task: the environment
    :param ours: mean returns of H-UCRL's latest episodes
    :param first: real steps after which each run of ours was first solved; infinity for never
    :param same: returns of SAC at the same real steps
    :param tenfold: returns of SAC at ten times as many
    """

    task: SuiteTask
    ours: list[float]
    first: list[float]
    same: list[float]
    tenfold: list[float]

    @classmethod
    def read(cls, results: pd.DataFrame, task: SuiteTask) -> Line:
        """
        :param results: rows of all runs
        :param task: the environment
        """
        of_task = results[results.env == task.env]

        def each(who: str, measure: Callable[[pd.DataFrame], float]) -> list[float]:
            values = [measure(run) for _, run in of_task[of_task.who == who].groupby("seed")]
            return [value for value in values if not np.isnan(value)]

        return cls(
            task,
            each("hucrl", lambda run: final_return(run, task, task.real_steps)),
            each("hucrl", lambda run: first_solved(run, task)),
            each("baseline", lambda run: final_return(run, task, task.real_steps)),
            each("baseline", lambda run: final_return(run, task, TENFOLD * task.real_steps)),
        )

    @property
    def verdict(self) -> Verdict:
        """Compares medians over the seeds."""
        if not self.ours:
            return "not run"
        ours = np.median(self.ours)
        if ours >= self.task.solved:
            return "solved"
        if not self.tenfold:
            return "not solved"
        return "better than SAC at 10x" if ours > np.median(self.tenfold) else "fails"

    def markdown(self) -> str:
        """A line of the table."""
        solved = _number(self.task.solved) + ("" if self.task.source == GYMNASIUM else " *")
        first = " ".join("-" if np.isinf(steps) else f"{steps:,.0f}" for steps in sorted(self.first))
        cells = (
            f"`{self.task.env}`",
            f"{self.task.real_steps:,}",
            solved,
            _range(self.ours),
            first,
            _range(self.same),
            _range(self.tenfold),
            self.verdict,
        )
        return "| " + " | ".join(cells) + " |"


def table(results: pd.DataFrame, tasks: Sequence[SuiteTask]) -> str:
    """
    :param results: rows of all runs
    :param tasks: the environments
    :return: counts, table, runs that failed, and thresholds of our own
    """
    lines = [Line.read(results, task) for task in tasks]
    rows = [f"| {' | '.join(HEADER)} |", "|---" * len(HEADER) + "|", *(line.markdown() for line in lines)]
    ours = [f"`{task.env}` ({task.source})" for task in tasks if task.source != GYMNASIUM]
    blocks = [_counts(lines), "\n".join(rows)]
    if ours:
        blocks.append("\\* Thresholds of our own: " + "; ".join(ours) + ".")
    return "\n\n".join([*blocks, *_runs(results), *_failures(results)])


def put_into(page: Path, block: str) -> None:
    """
    Replace what is between the two marks on a page.

    :param page: with a line ``<!-- suite -->`` and a later one ``<!-- end of suite -->``
    :param block: in Markdown
    :raises ValueError: if a mark is missing
    """
    text = page.read_text()
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"{page} has no place for the table: add the lines {BEGIN!r} and {END!r}")
    page.write_text(f"{before}{BEGIN}\n{block}\n{END}{after}")


def _counts(lines: Sequence[Line]) -> str:
    verdicts = [line.verdict for line in lines]
    solved, better, fails = (verdicts.count(name) for name in ("solved", "better than SAC at 10x", "fails"))
    undecided = len(lines) - solved - better - fails
    return (
        f"**{solved + better} of {len(lines)}**: {solved} solved, {better} not solved but better than SAC with ten "
        f"times the real steps. {fails} fail" + (f", {undecided} are not decided yet." if undecided else ".")
    )


def _runs(results: pd.DataFrame) -> list[str]:
    """Which runs there are, and of which commits: the table mixes whatever it finds."""
    described = []
    for who, name in (("hucrl", "H-UCRL"), ("baseline", "SAC")):
        rows = results[results.who == who]
        if rows.empty:
            continue
        runs = len(rows[["env", "seed"]].drop_duplicates())
        seeds = " ".join(str(seed) for seed in sorted(rows.seed.unique()))
        algos, commits = ("`, `".join(sorted(rows[column].astype(str).unique())) for column in ("algo", "commit"))
        described.append(f"{name}: `{algos}`, number of runs: {runs}, seeds: {seeds}, commit: `{commits}`.")
    return [" ".join(described)] if described else []


def _failures(results: pd.DataFrame) -> list[str]:
    runs = [
        f"- {'H-UCRL' if who == 'hucrl' else 'SAC'} on `{env}`, seed {seed}: `{run.error.iloc[0]}`"
        for (who, env, seed), run in results.groupby(["who", "env", "seed"])
        if failed(run)
    ]
    return ["Runs that ended with an error:", "\n".join(runs)] if runs else []


def _range(values: Sequence[float]) -> str:
    if not values:
        return ""
    median = _number(float(np.median(values)))
    return median if len(values) == 1 else f"{median} ({_number(min(values))} to {_number(max(values))})"


def _number(value: float) -> str:
    if np.isneginf(value):
        return "error"
    return f"{value:,.0f}" if abs(value) >= 100 or value == int(value) else f"{value:.3g}"
