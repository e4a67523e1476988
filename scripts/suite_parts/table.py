"""The table of the suite, in Markdown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

from suite_parts.measure import failed, final_return, first_solved
from suite_parts.plans import TENFOLD
from suite_parts.tasks import GYMNASIUM, SuiteTask

#: the policy searches in imagination that are compared with SAC, by the name of their side
SEARCHES = {"hucrl": "H-UCRL", "hsvg": "H-SVG"}
SIDES = {**SEARCHES, "baseline": "SAC"}
BRIEF_HEADER = ("environment", "real steps", *SEARCHES.values(), "SAC, same steps", "SAC, ten times the steps")
HEADER = (
    *("environment", "real steps", "solved at"),
    *(column for name in SEARCHES.values() for column in (name, "first solved, each seed", "verdict")),
    *("SAC, same steps", "SAC, ten times the steps"),
)
Verdict = Literal["solved", "better than SAC at 10x", "fails", "not solved", "not run"]
SUCCESSES: tuple[Verdict, ...] = ("solved", "better than SAC at 10x")
FAILURES: tuple[Verdict, ...] = ("fails", "not solved")


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
class Search:
    """
    What a policy search reached on one environment. Each number is of one run, in the order of the seeds.

    :param returns: mean returns of the latest episodes; minus infinity for a failed run
    :param first: real steps after which each run was first solved; infinity for never
    :param verdict: compares medians over the seeds
    """

    returns: list[float]
    first: list[float]
    verdict: Verdict

    @property
    def succeeds(self) -> bool:
        """Whether the environment counts for this search."""
        return self.verdict in SUCCESSES

    def cells(self) -> tuple[str, str, str]:
        """Of the table."""
        first = " ".join("-" if np.isinf(steps) else f"{steps:,.0f}" for steps in sorted(self.first))
        return _range(self.returns), first, self.verdict


@dataclass(frozen=True)
class Line:
    """
    One environment.

    :param task: the environment
    :param searches: by the name of their side
    :param same: returns of SAC at the same real steps, one of each run
    :param tenfold: returns of SAC at ten times as many
    """

    task: SuiteTask
    searches: dict[str, Search]
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

        def after(who: str, steps: int) -> list[float]:
            return each(who, lambda run: final_return(run, task, steps))

        tenfold = after("baseline", TENFOLD * task.real_steps)
        searches = {}
        for who in SEARCHES:
            returns, first = after(who, task.real_steps), each(who, lambda run: first_solved(run, task))
            searches[who] = Search(returns, first, _verdict(task, returns, tenfold))
        return cls(task, searches, after("baseline", task.real_steps), tenfold)

    def markdown(self) -> str:
        """A line of the table."""
        solved = _number(self.task.solved) + ("" if self.task.source == GYMNASIUM else " *")
        cells = (
            *(f"`{self.task.env}`", f"{self.task.real_steps:,}", solved),
            *(cell for search in self.searches.values() for cell in search.cells()),
            *(_range(self.same), _range(self.tenfold)),
        )
        return _row(cells)

    def brief(self) -> str:
        """A line of the short table: medians alone, in bold type where one counts as a success."""
        medians = {who: _median(search.returns) or "not run" for who, search in self.searches.items()}
        cells = (
            *(f"`{self.task.env}`", f"{self.task.real_steps:,}"),
            *(f"**{medians[who]}**" if search.succeeds else medians[who] for who, search in self.searches.items()),
            *(_median(returns) or "not run" for returns in (self.same, self.tenfold)),
        )
        return _row(cells)


def _verdict(task: SuiteTask, ours: Sequence[float], tenfold: Sequence[float]) -> Verdict:
    if not ours:
        return "not run"
    if np.median(ours) >= task.solved:
        return "solved"
    if not tenfold:
        return "not solved"
    return "better than SAC at 10x" if np.median(ours) > np.median(tenfold) else "fails"


def table(results: pd.DataFrame, tasks: Sequence[SuiteTask]) -> str:
    """
    :param results: rows of all runs
    :param tasks: the environments
    :return: counts, table, runs that failed, and thresholds of our own
    """
    lines = [Line.read(results, task) for task in tasks]
    rows = _markdown(HEADER, [line.markdown() for line in lines])
    ours = [f"`{task.env}` ({task.source})" for task in tasks if task.source != GYMNASIUM]
    blocks = [_counts(lines), rows]
    if ours:
        blocks.append("\\* Thresholds of our own: " + "; ".join(ours) + ".")
    return "\n\n".join([*blocks, *_runs(results), *_failures(results)])


def brief_table(results: pd.DataFrame, tasks: Sequence[SuiteTask]) -> str:
    """
    :param results: rows of all runs
    :param tasks: the environments
    :return: medians over the seeds
    """
    return _markdown(BRIEF_HEADER, [Line.read(results, task).brief() for task in tasks])


def diagnoses(results: pd.DataFrame, tasks: Sequence[SuiteTask]) -> str:
    """
    :param results: rows of all runs
    :param tasks: the environments
    :return: of each search that fails on an environment, what was said of each run that did not solve it
    """
    blocks = []
    for task in tasks:
        searches = Line.read(results, task).searches
        for who in (who for who, search in searches.items() if search.verdict in FAILURES):
            runs = results[(results.env == task.env) & (results.who == who)]
            said = [
                f"  - seed {seed}, {_number(final)}: {run.diagnosis.iloc[0]}"
                for seed, run in runs.groupby("seed")
                if (final := final_return(run, task, task.real_steps)) < task.solved and _is_diagnosed(run)
            ]
            blocks.extend([f"- {SEARCHES[who]} on `{task.env}`:", *said] if said else [])
    return "\n".join(blocks)


def _is_diagnosed(run: pd.DataFrame) -> bool:
    # CSVs of earlier versions have no such column.
    return "diagnosis" in run and bool(run.diagnosis.notna().all())


def put_into(page: Path, blocks: Mapping[str, str]) -> None:
    """
    Replace what is between two marks on a page.

    :param page: with a line ``<!-- name -->`` and a later one ``<!-- end of name -->``, for one of the names at least
    :param blocks: Markdown, by its name
    :raises ValueError: if a page has no pair of marks
    """
    text = page.read_text()
    found = False
    for name, block in blocks.items():
        before, begin, rest = text.partition(f"<!-- {name} -->")
        _, end, after = rest.partition(f"<!-- end of {name} -->")
        if begin and end:
            found, text = True, f"{before}{begin}\n{block}\n{end}{after}"
    if not found:
        pairs = " or ".join(f"'<!-- {name} -->' and '<!-- end of {name} -->'" for name in blocks)
        raise ValueError(f"{page} has no place for the table: add the lines {pairs}")
    page.write_text(text)


def _markdown(header: Sequence[str], rows: Sequence[str]) -> str:
    return "\n".join([_row(header), "|---" * len(header) + "|", *rows])


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _counts(lines: Sequence[Line]) -> str:
    counts = []
    for who, name in SEARCHES.items():
        verdicts = [line.searches[who].verdict for line in lines]
        solved, better, fails = (verdicts.count(each) for each in (*SUCCESSES, "fails"))
        undecided = len(lines) - solved - better - fails
        counts.append(
            f"**{name}: {solved + better} of {len(lines)}**: {solved} solved, {better} not solved but better than SAC "
            f"with ten times the real steps. {fails} fail"
            + (f", and of {undecided} not solved it is not known, as SAC has not been run there." if undecided else ".")
        )
    return "\n\n".join(counts)


def _runs(results: pd.DataFrame) -> list[str]:
    """Which runs there are, and of which commits: the table mixes whatever it finds."""
    described = []
    for who, name in SIDES.items():
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
        f"- {SIDES[str(who)]} on `{env}`, seed {seed}: `{run.error.iloc[0]}`"
        for (who, env, seed), run in results.groupby(["who", "env", "seed"])
        if failed(run)
    ]
    return ["Runs that ended with an error:", "\n".join(runs)] if runs else []


def _median(values: Sequence[float]) -> str:
    return _number(float(np.median(values))) if values else ""


def _range(values: Sequence[float]) -> str:
    return (
        _median(values) if len(values) <= 1 else f"{_median(values)} ({_number(min(values))} to {_number(max(values))})"
    )


def _number(value: float) -> str:
    if np.isneginf(value):
        return "error"
    return f"{value:,.0f}" if abs(value) >= 100 or value == int(value) else f"{value:.3g}"
