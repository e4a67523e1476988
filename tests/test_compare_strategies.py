"""The comparison of strategies over tasks: scores, interquartile means and probabilities of improvement."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import trim_mean

from compare_strategies import GROUPS, Group, interquartile_means, main, probabilities_of_improvement
from figures.curves import STRATEGIES


def write_runs(folder: Path, group: Group, returns: dict[str, float]) -> None:
    """Four episodes for each run, of which the first does not count."""
    for strategy, value in returns.items():
        for seed, row in zip(group.seeds, group.jobs(strategy), strict=True):
            for job in row:
                path = job.path(folder)
                path.parent.mkdir(parents=True, exist_ok=True)
                returned = [1e6, *(value + seed - group.seeds[0] + noise for noise in (-1, 0, 1))]
                pd.DataFrame({"episode": [1, 2, 3, 4], "real_return": returned}).to_csv(path, index=False)


def test_a_score_is_zero_for_doing_nothing_and_one_for_solved(tmp_path: Path) -> None:
    group = Group("swing-ups", (6, 7), True, (51, 52))
    write_runs(tmp_path, group, {"optimistic": 149, "greedy": 0, "thompson": 0})
    nothing = pd.Series({"HUCRL-Pendulum-v0": -51.0, "HUCRL-CartPole-v0": 0.0})
    scores = group.scores(tmp_path, nothing)
    # Two penalties of each; the pendulum is solved at 150, the cart-pole at 100.
    expected = [[200 / 201] * 2 + [1.49] * 2, [1.0] * 2 + [1.5] * 2]
    np.testing.assert_allclose(scores["optimistic"], expected)
    assert scores["greedy"].shape == (2, 4)


def test_the_middle_half_is_averaged_and_failures_count_as_zero() -> None:
    runs = np.random.default_rng(0).normal(size=(4, 6))
    estimates = interquartile_means({"some": runs, "same": np.full((3, 2), 0.5)})
    assert estimates["some"].point == pytest.approx(trim_mean(np.maximum(runs, 0), 0.25, axis=None))
    assert estimates["some"].low < estimates["some"].point < estimates["some"].high
    assert str(estimates["same"]) == "0.50 (0.50 to 0.50)"
    assert interquartile_means({"some": runs})["some"] == estimates["some"]


def test_improvement_is_counted_over_pairs_of_runs_on_the_same_task() -> None:
    ours = np.array([[1.0, 5.0], [3.0, 5.0]])
    others = np.array([[2.0, 5.0], [2.0, 9.0]])
    # Of the first task half of the pairs are won; of the second half are ties and half are lost.
    estimates = probabilities_of_improvement({"optimistic": ours, "greedy": others})
    assert list(estimates) == ["greedy"]
    estimate = estimates["greedy"]
    assert estimate.point == pytest.approx((0.5 + 0.25) / 2)
    assert 0 <= estimate.low <= estimate.point <= estimate.high <= 1


def test_table_and_picture_show_all_groups(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for group in GROUPS:
        write_runs(tmp_path, group, {strategy: 100.0 * number for number, strategy in enumerate(STRATEGIES)})
    picture = tmp_path / "picture.png"
    monkeypatch.setattr("compare_strategies.RESAMPLES", 20)
    monkeypatch.setattr(sys, "argv", ["compare_strategies.py", "--output", str(tmp_path), "--picture", str(picture)])
    main()
    printed = capsys.readouterr().out
    for group in GROUPS:
        assert printed.count(group.name) == 2
    assert picture.stat().st_size > 10_000
