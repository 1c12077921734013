"""The table of a training: one line per episode, which is in the file when it has been added."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np

from whiptool.rl.training import TrainingEpisode
from whiptool.whole_files import append_whole, write_whole

_OTHERS = ("losses", "held_out", "best")  # of an episode, in separate columns, or elsewhere
HELD_OUT = ("held_out_hit", "held_out_cost")


class EpisodeTable:
    """A CSV file with one line per training episode; cells are empty if an episode has no such value.

    Args:
        path: Path of the file, which may hold earlier episodes.
        losses: Names of the learner's losses.
    """

    def __init__(self, path: Path, losses: Sequence[str]) -> None:
        self.path = path
        self.names = [*(f.name for f in fields(TrainingEpisode) if f.name not in _OTHERS), *losses, *HELD_OUT]

    def cut(self, episodes: int) -> None:
        """Keep only the lines of the first `episodes` episodes; later episodes will be repeated."""
        lines = self.path.read_text(encoding="utf-8").splitlines(keepends=True) if self.path.exists() else []
        write_whole(self.path, "".join(lines[: 1 + episodes if episodes else 0]))
        if episodes and lines:
            self.names = lines[0].strip().split(",")  # an older version's run may lack columns

    def add(self, episode: TrainingEpisode) -> None:
        """Append an episode.

        Raises:
            OSError: The file cannot be written; no partial line is left.
        """
        row = {name: getattr(episode, name) for name in self.names if hasattr(episode, name)} | episode.losses
        if episode.held_out is not None:
            row |= dict(zip(HELD_OUT, (episode.held_out.share_hit, episode.held_out.mean_cost), strict=True))
        text = io.StringIO()
        writer = csv.DictWriter(text, self.names, lineterminator="\n", extrasaction="ignore")
        if self.path.stat().st_size == 0:
            writer.writeheader()
        writer.writerow(row)
        append_whole(self.path, text.getvalue())

    def columns(self) -> dict[str, np.ndarray]:
        """Return the numbers of all episodes by column, (E,) each; NaN where a value is missing."""
        with self.path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        return {name: np.array([float(row.get(name) or "nan") for row in rows]) for name in (*self.names, *HELD_OUT)}
