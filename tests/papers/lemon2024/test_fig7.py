"""Verdicts on Fig. 7 follow the data."""

from __future__ import annotations

import numpy as np
import pytest

from papers.lemon2024 import fig7
from whiptool.viz import report


@pytest.mark.parametrize(("sac", "expected"), [(40.0, [True, True]), (15.0, [True, False]), (5.0, [False, False])])
def test_rewards_decide_the_claims_of_fig7(sac, expected):
    rewards = {"sac": np.full(3, sac), "td3": np.full(3, 10.0), "ddpg": np.full(3, 9.0), "ppo": np.full(3, -2.0)}
    claims = fig7.claims({"tip": rewards})
    assert [claim.verdict == report.REPRODUCED for claim in claims] == expected
    assert "inf" not in claims[1].reason
    assert f"{sac:.1f} against -2.0 of PPO, which has no multiples" in claims[1].reason
