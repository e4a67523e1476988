"""A diagnosis as one picture."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

from sb3_hucrl.diagnosis.diagnosis import Diagnosis
from sb3_hucrl.diagnosis.model import TRUSTED_ERROR
from sb3_hucrl.imagination.accuracy import middle

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: errors are drawn between these
NEAR, FAR = 1e-3, 10.0


def draw_diagnosis(diagnosis: Diagnosis, title: str, picture: Path) -> None:
    """
    :param diagnosis: of a run
    :param title: above the picture
    :param picture: is written
    """
    # Imported late, because importing matplotlib takes long.
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 7.5), layout="constrained")
    axes = figure.subplots(2, 3)
    panels = (_one_step, _many_steps, _promises, _search, _actions, _exploration)
    for axis, draw in zip(axes.flat, panels, strict=True):
        draw(axis, diagnosis)
        axis.grid(alpha=0.3)
    answer = "\n".join(textwrap.wrap(diagnosis.answer.sentence, 135))
    figure.suptitle(f"{title}\n{answer}", fontsize=10)
    picture.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(picture, dpi=110)


def _one_step(axis: Axes, diagnosis: Diagnosis) -> None:
    unseen = diagnosis.model.unseen
    numbers = [each.episode for each in unseen]
    least = [float(each.r2.nan_to_num(nan=1.0).min()) for each in unseen]
    covered = [each.coverage[1] for each in unseen]
    axis.plot(numbers, [middle(each.r2) for each in unseen], marker="o", label="R², median dimension")
    axis.plot(numbers, least, marker="o", linestyle=":", label="R², worst dimension")
    axis.plot(numbers, covered, "--", color="0.5", label="errors within 2 std (0.95 is right)")
    axis.set(title="One-step predictions of episodes not seen", xlabel="real episode", ylim=(-0.1, 1.05))
    axis.legend(fontsize=8, loc="lower right")
    _whole_numbers(axis)


def _many_steps(axis: Axes, diagnosis: Diagnosis) -> None:
    unseen = diagnosis.model.unseen
    for index, each in enumerate(unseen):
        shade = 0.25 + 0.75 * (index + 1) / len(unseen)
        axis.plot(
            range(1, len(each.errors) + 1),
            each.errors.clamp(NEAR, FAR),
            color="C0",
            alpha=shade,
            label=f"episode {each.episode}",
        )
    axis.axhline(TRUSTED_ERROR, color="C3", linestyle="--", label="beyond: lost")
    axis.set(title="Error along the real actions", xlabel="steps ahead", ylabel="standard deviations of the state")
    axis.set(xscale="log", yscale="log")
    axis.legend(fontsize=8)


def _promises(axis: Axes, diagnosis: Diagnosis) -> None:
    axis.set(title=f"Return of the first {diagnosis.setup.horizon} steps", xlabel="real episode")
    promises = [] if diagnosis.imagination is None else diagnosis.imagination.promises
    if not promises:
        _nothing(axis, "nothing was imagined before real episodes")
        return
    numbers = [each.episode for each in promises]
    imagined = [each.imagined for each in promises]
    # Above the other: where promises are kept, the two are one line.
    axis.plot(numbers, imagined, "--", marker="o", color="C1", zorder=3, label="imagined before it")
    axis.plot(numbers, [each.real for each in promises], marker="o", color="C0", label="real")
    axis.legend(fontsize=8)
    _whole_numbers(axis)


def _search(axis: Axes, diagnosis: Diagnosis) -> None:
    axis.set(title="What the policy earns in imagination")
    search = diagnosis.search
    if search is None:
        _nothing(axis, "no policy: actions are planned")
        return
    bars = {
        "policy": search.mode,
        "without\nhallucination": search.unsteered,
        "random\nactions": search.random,
        "doing\nnothing": search.nothing,
    }
    if diagnosis.setup.strategy != "optimistic":
        del bars["without\nhallucination"]
    colours = ["0.6" if name in ("random\nactions", "doing\nnothing") else "C1" for name in bars]
    drawn = axis.bar(list(bars), list(bars.values()), color=colours)
    axis.bar_label(drawn, fmt="%.1f", fontsize=8, padding=3)
    axis.axhline(0, color="0.3", linewidth=0.8)
    axis.tick_params(axis="x", labelsize=8)
    low, high = min(0.0, *bars.values()), max(0.0, *bars.values())
    room = 0.15 * (high - low or 1.0)
    axis.set_ylim(low - room, high + room)


def _actions(axis: Axes, diagnosis: Diagnosis) -> None:
    axis.set(title="Fractions: policy and imagination", xlim=(0, 1))
    search, imagination = diagnosis.search, diagnosis.imagination
    if search is None or imagination is None:
        _nothing(axis, "no policy: actions are planned")
        return
    bars = {
        "size of the actions": search.effort,
        "actions at their bounds": search.saturated,
        "imagined steps beyond\nthe visited range": imagination.outside,
        "trajectories ended\nby the task": imagination.terminated,
        "trajectories ended\nby the cap": imagination.capped,
        "epistemic std /\none-step changes": min(imagination.uncertainty, 1.0),
    }
    drawn = axis.barh(list(bars)[::-1], list(bars.values())[::-1], color="C2")
    axis.bar_label(drawn, fmt="%.2f", fontsize=8, padding=2)
    axis.tick_params(axis="y", labelsize=8)


def _exploration(axis: Axes, diagnosis: Diagnosis) -> None:
    exploration = diagnosis.exploration
    numbers = range(1, len(exploration.cells) + 1)
    axis.bar(numbers, exploration.cells, color="0.8", label="visited")
    axis.bar(numbers, exploration.new, color="C4", label="new")
    axis.set(title="Visited cells of the two main directions", xlabel="real episode", ylabel="cells")
    axis.legend(fontsize=8)
    _whole_numbers(axis)


def _nothing(axis: Axes, text: str) -> None:
    axis.text(0.5, 0.5, text, transform=axis.transAxes, ha="center", fontsize=9)


def _whole_numbers(axis: Axes) -> None:
    from matplotlib.ticker import MaxNLocator

    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
