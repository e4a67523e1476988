"""A diagnosis as text: the answer first, then a short table for each group."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from sb3_hucrl.diagnosis.diagnosis import Diagnosis
from sb3_hucrl.diagnosis.imagination import ImaginationMeasures
from sb3_hucrl.diagnosis.model import STEPS, ModelMeasures, worst
from sb3_hucrl.diagnosis.search import SearchMeasures
from sb3_hucrl.diagnosis.verdict import Level, Verdict
from sb3_hucrl.imagination.accuracy import middle

COLOURS = {Level.FINE: "green", Level.NOTE: "yellow", Level.CAUSE: "red"}
#: columns of tables with one column for each real episode
LATEST_EPISODES = 8


def print_diagnosis(diagnosis: Diagnosis, console: Console) -> None:
    """
    :param diagnosis: of a run
    :param console: to print to
    """
    _print_verdict(diagnosis.answer, console, mark=False)
    tables = {
        "model": [_model_table(diagnosis.model, diagnosis.setup.horizon)],
        "imagination": _imagination_tables(diagnosis.imagination),
        "search": _search_tables(diagnosis.search),
        "exploration": [_exploration_table(diagnosis)],
    }
    for name, found in tables.items():
        console.print()
        console.print(Text(name.capitalize(), style="bold"))
        if not found:
            console.print("The algorithm plans and has no policy: nothing to measure here.")
            continue
        for each in found:
            console.print(each)
        for verdict in diagnosis.verdicts.get(name, []):
            _print_verdict(verdict, console, mark=True)


def _print_verdict(verdict: Verdict, console: Console, mark: bool) -> None:
    colour = COLOURS[verdict.level]
    sign = f"[{colour}]{verdict.level.value}:[/{colour}] " if mark else ""
    console.print(f"{sign}[{'' if mark else 'bold '}{colour if not mark else 'default'}]{escape(verdict.sentence)}[/]")
    if verdict.settings:
        first, *others = verdict.settings
        then = f", then {' '.join(others)}" if others and mark else ""
        console.print(
            f"{'  try' if mark else 'Change first:'} [bold]-params {escape(first)}[/]{escape(then)}", soft_wrap=True
        )


def _table(*columns: str) -> Table:
    table = Table(box=None, pad_edge=False, show_header=len(columns) > 1, header_style="dim")
    table.add_column(columns[0] if len(columns) > 1 else "")
    for column in columns[1:] or ("",):
        table.add_column(column, justify="right")
    return table


def _model_table(model: ModelMeasures, horizon: int) -> Table:
    shown = model.unseen
    table = _table("predicts episode", *(str(each.episode) for each in shown), "its own data")
    table.add_row("R² of one step", *(f"{middle(each.r2):.2f}" for each in shown), f"{middle(model.fitted_r2):.2f}")
    dims = [worst(each.r2) for each in shown]
    names = [
        f"{model.names[dim].removeprefix('dimension ')}: {float(each.r2[dim]):.2f}"
        for dim, each in zip(dims, shown, strict=True)
    ]
    table.add_row("worst dimension: R²", *names)
    for steps in (*(each for each in STEPS if each < horizon), horizon):
        errors = (f"{each.error_after(steps):.2f}" for each in shown)
        table.add_row(f"error after {steps} step{'s' * (steps > 1)}", *errors)
    for index, std in enumerate((1, 2)):
        table.add_row(f"errors within {std} std", *(f"{each.coverage[index]:.0%}" for each in shown))
    return table


def _imagination_tables(imagination: ImaginationMeasures | None) -> list[Table]:
    if imagination is None:
        return []
    latest = imagination.promises[-LATEST_EPISODES:]
    table = _table("return of episode", *(str(each.episode) for each in latest))
    if latest:
        table.add_row("imagined before it", *(f"{each.imagined:.1f}" for each in latest))
        table.add_row("real", *(f"{each.real:.1f}" for each in latest))
    now = _table("")
    now.add_row("steps beyond the visited range", f"{imagination.outside:.0%}")
    now.add_row("farthest, in widths of that range", f"{imagination.farthest:.1f}")
    now.add_row(
        "ended by the task / by the uncertainty cap", f"{imagination.terminated:.0%} / {imagination.capped:.0%}"
    )
    now.add_row("epistemic std, of a one-step change", f"{imagination.uncertainty:.2f}")
    return [table, now] if latest else [now]


def _search_tables(search: SearchMeasures | None) -> list[Table]:
    if search is None:
        return []
    table = _table("")
    for name, value in _search_rows(search):
        table.add_row(name, value)
    return [table]


def _search_rows(search: SearchMeasures) -> Iterator[tuple[str, str]]:
    yield "imagined return of the policy's mode", f"{search.mode:.1f}"
    yield "  without hallucination", f"{search.unsteered:.1f}"
    yield "  of random actions", f"{search.random:.1f}"
    yield "  of doing nothing", f"{search.nothing:.1f}"
    if search.critic is not None:
        yield (
            "critic's value of start states / what is earned there",
            f"{search.critic.value:.1f} / {search.critic.earned:.1f}",
        )
    else:
        yield "critic's value of start states", "no critic"
    coefficient = search.entropy_coefficient
    yield "entropy coefficient", "none" if coefficient is None else f"{coefficient:.3g}"
    yield "mean size of the actions (1: at their bounds)", f"{search.effort:.2f}"
    yield "actions at their bounds", f"{search.saturated:.0%}"


def _exploration_table(diagnosis: Diagnosis) -> Table:
    exploration = diagnosis.exploration
    count = len(exploration.returns)
    first = max(count - LATEST_EPISODES, 0)
    table = _table("real episode", *(str(number) for number in range(first + 1, count + 1)))
    table.add_row("return", *(f"{value:.1f}" for value in exploration.returns[first:]))
    table.add_row("new part of its states", *(f"{each:.0%}" for each in exploration.new_fractions[first:]))
    return table
