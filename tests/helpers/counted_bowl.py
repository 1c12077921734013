"""A bowl that counts the strikes at it."""

from __future__ import annotations

from toy_objectives import Bowl


class Counted(Bowl):
    max_trials: int | None = 5
    max_time: float | None = None

    def trial(self, strike):
        return self.gradient(strike)[0]
