"""Real episodes as lines of text."""

from __future__ import annotations

import sys

from rich.console import Console
from rich.text import Text

from sb3_hucrl.checks import validated
from sb3_hucrl.imagination.accuracy import POOR_R2
from sb3_hucrl.loop.report import PlayedEpisode, Report

#: widths of the columns, by their titles
COLUMNS = {
    "episode": 7,
    "real steps": 10,
    "return": 8,
    "promised": 8,
    "model R²": 8,
    "best": 8,
    "search": 7,
    "real": 6,
    "fit": 6,
}
#: the last three of them, as they are logged
SECONDS = ("time/search_seconds", "time/rollout_seconds", "time/fit_seconds")
#: one-step R² from which on a model is good
GOOD_R2 = 0.9


@validated
class EpisodeLines:
    """
    Prints one line for each real episode, the first below a header, in colour where the terminal can. Between two
    refits there may be several episodes: the last of them has the seconds. They are those of all refits since the
    last line, of which there are several where refits do not wait for the end of an episode.
    """

    def __init__(self) -> None:
        self._has_header = False
        self._seconds: dict[str, float] = {}

    def print(self, report: Report) -> None:
        """
        :param report: of the loop
        """
        for name in SECONDS:
            if name in report.scalars:
                self._seconds[name] = self._seconds.get(name, 0.0) + report.scalars[name]
        if not report.episodes:
            return
        lines = [] if self._has_header else [_line([*COLUMNS], ["bold"] * len(COLUMNS))]
        seconds = [_seconds(self._seconds.get(name)) for name in SECONDS]
        self._seconds = {}
        for episode in report.episodes:
            shown = seconds if episode is report.episodes[-1] else [""] * len(SECONDS)
            lines.append(_line([*_cells(episode), *shown], _styles(episode)))
        self._has_header = True
        console = Console(highlight=False)
        with console.capture() as text:
            for line in lines:
                console.print(line, soft_wrap=True)
        # A progress bar gives way to what is printed, not to what another Console writes. Not every file can hold ².
        encoding = sys.stdout.encoding or "utf-8"
        print(text.get().encode(encoding, "replace").decode(encoding), end="", flush=True)


def _line(cells: list[str], styles: list[str]) -> Text:
    columns = zip(cells, styles, COLUMNS.values(), strict=True)
    return Text(" ").join(Text(cell.rjust(width), style) for cell, style, width in columns)


def _cells(episode: PlayedEpisode) -> list[str]:
    r2 = "-" if episode.r2 is None else _number(episode.r2, decimals=3)
    promised = "-" if episode.promised is None else _number(episode.promised)
    earned, best = _number(episode.episode_return), _number(episode.best)
    return [str(episode.number), f"{episode.real_steps:,}", earned, promised, r2, best]


def _styles(episode: PlayedEpisode) -> list[str]:
    is_best = "green" if episode.episode_return >= episode.best else ""
    quality = ""
    if episode.r2 is not None:
        quality = "green" if episode.r2 >= GOOD_R2 else "yellow" if episode.r2 >= POOR_R2 else "red"
    return ["bold", "", is_best, "", quality, is_best, *["dim"] * len(SECONDS)]


def _number(value: float, decimals: int = 2) -> str:
    if abs(value) < 1e4 / 10 ** (decimals - 2):
        return f"{value:.{decimals}f}"
    return f"{value:.0f}" if abs(value) < 1e7 else f"{value:.1e}"


def _seconds(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:.1f}s" if value < 1000 else f"{value:.0f}s"
