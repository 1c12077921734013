"""What is beyond a limit, and when."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Excess:
    """What is beyond a limit, and when; as a string a sentence such as `at 0.300 s the arm is 5 mm below the floor`."""

    words: str  # what is beyond which limit
    t: float | None = None  # the instant [s]; None: there is no single one
    overlap: bool = False  # whether two shapes are inside each other, which may be so by the model's file alone

    def __str__(self) -> str:
        return self.words if self.t is None else f"at {self.t:.3f} s {self.words}"

    def by_parts(self, begins: float) -> str:
        """Return the sentence with the instant on the way to a strike's start, or in the strike, which begins at
        `begins` [s].
        """
        if self.t is None:
            return self.words
        if self.t < begins:
            return f"on the way to the start, at {self.t:.3f} s, {self.words}"
        return f"{self.t - begins:.3f} s into the strike {self.words}"
