"""How much of what real episodes visit is new."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch as th

from sb3_hucrl.data import TransitionDataset
from sb3_hucrl.diagnosis.units import Units

#: cells of the grid in each direction
CELLS = 20


@dataclass(frozen=True)
class ExplorationMeasures:
    """
    :param returns: of all real episodes
    :param cells: that each real episode visited, of a grid over the first two principal components of visited states
    :param new: how many of them neither an earlier one nor logged data had visited
    """

    returns: list[float]
    cells: list[int]
    new: list[int]

    @property
    def new_fractions(self) -> list[float]:
        """Of the cells of each episode."""
        return [new / cells for new, cells in zip(self.new, self.cells, strict=True)]


def measure_exploration(dataset: TransitionDataset, units: Units) -> ExplorationMeasures:
    """
    :param dataset: with all real episodes
    :param units: of states
    """
    cells = visited_cells(units.features(dataset.transitions.states))
    begin = dataset.logged_steps
    seen = set(cells[:begin].tolist())
    counts, new = [], []
    for length in dataset.lengths:
        here = set(cells[begin : begin + length].tolist())
        counts.append(len(here))
        new.append(len(here - seen))
        seen |= here
        begin += length
    returns = [float(episode.rewards.sum(dtype=th.float64)) for episode in dataset.episodes]
    return ExplorationMeasures(returns, counts, new)


def visited_cells(features: th.Tensor) -> npt.NDArray[np.int64]:
    """
    :param features: of the visited states, standardised, shape (n, k)
    :return: the number of the cell of each, shape (n,)
    """
    _, _, directions = th.linalg.svd(features - features.mean(dim=0), full_matrices=False)
    projected = features @ directions[:2].T
    low, high = projected.amin(dim=0), projected.amax(dim=0)
    width = th.where(high > low, high - low, 1.0)
    index = ((projected - low) / width * CELLS).long().clamp(max=CELLS - 1)
    weights = th.tensor([1, CELLS])[: index.shape[1]]
    found: npt.NDArray[np.int64] = (index * weights).sum(dim=1).numpy()
    return found
