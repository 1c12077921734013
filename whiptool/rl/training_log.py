"""Logs of a training: a table with one line per episode, and scalars for TensorBoard."""

from __future__ import annotations

import csv
import io
import os
import socket
import time
from collections.abc import Mapping, Sequence
from dataclasses import fields
from io import BytesIO
from pathlib import Path

import numpy as np
from tensorboard.compat.proto.event_pb2 import Event, SessionLog
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.record_writer import RecordWriter

from whiptool.errors import InputError
from whiptool.given_files import read_text
from whiptool.rl.training import TrainingEpisode
from whiptool.whole_files import append_whole, write_whole

_OTHERS = ("losses", "held_out", "best")  # of an episode, in separate columns, or elsewhere
HELD_OUT = ("held_out_hit", "held_out_cost")


def _is_number(text: str) -> bool:
    """Whether a cell holds a number or nothing."""
    try:
        float(text or "nan")
    except ValueError:
        return False
    return True


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
        """Keep only the lines of the first `episodes` episodes; later episodes will be repeated.

        Raises:
            InputError: The file does not hold a table of episodes, or the lines to be kept are damaged.
        """
        lines = read_text(self.path, "CSV").splitlines(keepends=True) if self.path.exists() else []
        kept = lines[: self._intact(lines, episodes)] if episodes else []
        write_whole(self.path, "".join(kept))
        if kept:
            self.names = kept[0].strip().split(",")  # an older version's run may lack columns

    def _intact(self, lines: Sequence[str], episodes: int) -> int:
        """Return how many of the lines are the header and those of episodes up to a number; damage among them is
        refused, so that the file stays as it is.
        """
        rows = [line.strip().split(",") for line in lines]
        first = int(rows[1][0]) if len(rows) > 1 and rows[1][0].isdecimal() else 1  # later if a table was moved away
        count = min(len(rows), max(1, episodes - first + 2))
        for i, row in enumerate(rows[:count]):
            right = len(row) == len(rows[0]) and row[0] == str(first + i - 1) and all(map(_is_number, row))
            if not (right if i else set(row) <= set(self.names) and row[0] == self.names[0]):
                rule = f"the episodes up to {episodes} in order, as training wrote them"
                fix = "restore it, or move it away: the run then goes on without those episodes in its table"
                raise InputError(f"{self.path}, line {i + 1}", lines[i], rule, fix)
        return count

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
        """Return the values of all E episodes by the name of the column, (E,) each; NaN where a value is missing."""
        with self.path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        return {name: np.array([float(row.get(name) or "nan") for row in rows]) for name in (*self.names, *HELD_OUT)}


class EventLog:
    """A new TensorBoard event file in a folder.

    PyTorch's own writer uses a thread, in which a full disk only causes a traceback without the file's name.

    Args:
        folder: Folder of the file, created if missing.
        first_step: Values of this and later steps in earlier files of the folder are no longer shown.

    Raises:
        OSError: The file cannot be written; it is named.
    """

    def __init__(self, folder: Path, *, first_step: int) -> None:
        folder.mkdir(exist_ok=True)
        self.path = folder / f"events.out.tfevents.{time.time_ns()}.{socket.gethostname()}.{os.getpid()}"
        self._append(Event(wall_time=time.time(), file_version="brain.Event:2"))
        start = SessionLog(status=SessionLog.START)
        self._append(Event(wall_time=time.time(), step=first_step, session_log=start))

    def add(self, values: Mapping[str, float], step: int) -> None:
        """Add scalars by name at a step; they are written to the file when this returns."""
        scalars = [Summary.Value(tag=name, simple_value=value) for name, value in values.items()]
        self._append(Event(wall_time=time.time(), step=step, summary=Summary(value=scalars)))

    def _append(self, event: Event) -> None:
        record = BytesIO()
        RecordWriter(record).write(event.SerializeToString())
        append_whole(self.path, record.getvalue())
