"""What the paper states about each of its figures, to be compared with what is found here.

All values are those that its text prints. What it only draws (the heights of bars, curves over time) is not read off
the pictures here, and said to be only drawn.
"""

from __future__ import annotations

from collections.abc import Sequence

from whiptool.viz.report import Table

DRAWN = "only drawn"
TARGETS, ZONE_RADIUS, HIT_RADIUS = 300, 0.1, 0.06  # Sect. 3.1.1; [m]
EPISODES, TRIALS, RANDOM_EPISODES = 500, 100, 50  # Sect. 3.1.2
RHO, TRAJECTORIES, FIGURE_TARGETS = 0.8909, 18, 3  # Sect. 3.3, Fig. 9
LONGEST = 1.5  # [s], of a strike (abstract)
SHARE_OF_TRIALS, TIMES_THE_REWARD = 0.2, 3.0  # of SAC, against the others (abstract)

TRIALS_OF = {
    "sac": f"the fewest, less than {SHARE_OF_TRIALS:.0%} of the others' (abstract)",
    "td3": "fewer than DIRECT-L and GA; about as many as DDPG",
    "ddpg": "fewer than DIRECT-L and GA; about as many as TD3",
    "directl": "more than SAC, TD3 and DDPG",
    "ga": "more than SAC, TD3 and DDPG",
    "ppo": "not fewer than DIRECT-L and GA",
}
REWARD_OF = {"sac": f"the highest, more than {TIMES_THE_REWARD:g} times the others' (abstract)"}


def compared(rows: Sequence[Sequence[str]], caption: str, *here: str) -> Table:
    """Return a table of what the paper says and what is found here.

    Args:
        rows: What, the paper's, and ours, in as many columns as `here` names.
        caption: Caption of the table.
        here: Heads of our columns; none: one that is called `here`.
    """
    return Table([["", "the paper", *(here or ("here",))], *rows], caption)
