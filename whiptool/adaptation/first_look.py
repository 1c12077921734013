"""A first look at a whip, before the first strike: as it hangs, or in an informative short, slow movement."""

from __future__ import annotations

import numpy as np

from whiptool.adaptation.prior import Belief, fresh_terms
from whiptool.errors import InputError
from whiptool.identification.predict import Predictor
from whiptool.limits.all_limits import Given
from whiptool.models.strike import T_STAY, Strike, StrikeBounds, default_bounds
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rollout.compiled import CompiledRollout
from whiptool.strike_map.striker import Striker

SWING = 0.7  # [rad] that a joint turns at most
DURATION = (0.4, 0.8)  # [s]
FASTEST = 8.0  # [m/s] of the tip: a strike has it at 10 to 40
STILL = 0.5  # [s] that a hanging whip is filmed, and `t_stay` more
WIDEST = 0.35  # [m], largest standard error of the tip's place, to which a linearised prior is used in space
FPS, NOISE = 60.0, 0.005  # [1/s], [m] of the camera that is expected


def information(
    belief: Belief, strikes: np.ndarray, *, t_stay: float = T_STAY
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the information gain of recording each strike, for a belief linearised around its mean.

    Args:
        belief: Belief before the recording.
        strikes: Strike vectors, (B, 2 a + 1).
        t_stay: Time after the movement's end for which the tip is still observed [s].

    Returns:
        Information gain, half the logarithm of the ratio of the determinants of prior and posterior covariance [nat],
        (B,); largest speed of the tip between two frames [m/s], (B,); largest standard error with which the belief
        predicts the tip's position in any frame [m], (B,).
    """
    recordings, d = [], belief.plant.model.dimension
    for vector in strikes:
        t = np.arange(int((vector[-1] + t_stay) * FPS) + 1) / FPS
        nothing = np.zeros((len(t), 1, d))
        recordings.append(StrikeRecording(t, nothing, ("tip",), np.array(NOISE), strike=Strike.from_vector(vector)))
    predictor = Predictor(recordings, belief.plant, drive="command", shared=belief.names)
    own = [np.zeros(0)] * len(recordings)
    nuisance = {"delay": belief.values().get("delay", 0.0)} if "delay" in belief.names else {}
    units = np.array([v.slope(x) for v, x in zip(belief.variables, belief.z, strict=True)])
    root = np.linalg.cholesky(belief.covariance)
    gain, fastest, widest = np.empty((3, len(strikes)))
    for i, p in enumerate(predictor(belief.at(), nuisance, own, derivatives=True)):
        J = p.by_shared * units / NOISE @ root  # by the whitened numbers
        widest[i] = NOISE * np.sqrt((J**2).sum(axis=1).reshape(-1, d).sum(axis=1).max())
        gain[i] = np.linalg.slogdet(np.eye(J.shape[1]) + J.T @ J)[1] / 2 if np.isfinite(J).all() else -np.inf
        fastest[i] = np.linalg.norm(np.diff(p.value.reshape(-1, d), axis=0), axis=1).max() * FPS
    return gain, np.where(np.isfinite(fastest), fastest, np.inf), np.where(np.isfinite(widest), widest, np.inf)


def hanging(belief: Belief, bounds: StrikeBounds | None = None) -> Strike:
    """Return a strike without movement, in the middle of the start postures: a hanging whip shows its length.

    Args:
        belief: About the arm.
        bounds: Box of strikes; default: `default_bounds`.
    """
    lower, upper = (bounds or default_bounds(belief.plant.model.arm)).box
    a = belief.plant.model.arm.n
    q = (lower[:a] + upper[:a]) / 2
    return Strike.from_vector(np.r_[q, q, STILL])


def choose_wiggle(
    belief: Belief,
    *,
    rng: np.random.Generator,
    bounds: StrikeBounds | None = None,
    t_stay: float = T_STAY,
    candidates: int = 32,
    keeps: Given = (),
) -> tuple[Strike, float]:
    """Return the D-optimal movement among short movements with a slow tip, and its information gain [nat].

    In space, the linearised prior overestimates the gain of movements whose outcome is hardly predictable; such
    movements are left out if others remain.

    Args:
        belief: Belief before the movement.
        rng: Random generator of the candidates.
        bounds: Box of strikes, in which the arm starts and remains; default: `default_bounds`.
        t_stay: As in `information`.
        candidates: Number of random movements that are compared.
        keeps: Limits that the movement has to keep, judged with the mean of the belief.

    Raises:
        InputError: No candidate is slow enough, or keeps the limits.
    """
    lower, upper = (bounds or default_bounds(belief.plant.model.arm)).box
    a = belief.plant.model.arm.n
    q_i = rng.uniform(lower[:a], upper[:a], (candidates, a))
    reach = np.minimum(lower[:a], lower[a:-1]), np.maximum(upper[:a], upper[a:-1])
    q_f = np.clip(q_i + rng.uniform(-SWING, SWING, q_i.shape), *reach)
    strikes = np.hstack([q_i, q_f, rng.uniform(*DURATION, (candidates, 1))])
    if keeps:
        strikes = _kept(belief, strikes, bounds, keeps, t_stay)
    gain, fastest, widest = information(belief, strikes, t_stay=t_stay)
    gain = np.where(fastest <= FASTEST, gain, -np.inf)
    foreseen = gain if belief.plant.model.dimension == 2 else np.where(widest <= WIDEST, gain, -np.inf)
    gain = foreseen if np.isfinite(foreseen).any() else gain
    best = int(gain.argmax())
    if not np.isfinite(gain[best]):
        raise InputError("wiggle", f"{fastest.min():.1f} m/s at the tip", f"{FASTEST:g} m/s", "strike without it")
    return Strike.from_vector(strikes[best]), float(gain[best])


def _kept(belief: Belief, strikes: np.ndarray, bounds: StrikeBounds | None, keeps: Given, t_stay: float) -> np.ndarray:
    """Those of some strikes, made as slow as their joints must be, that keep the limits."""
    plant = belief.at()
    assert plant.controller is not None
    rollout = CompiledRollout(plant.model, plant.controller, free=fresh_terms(belief))
    striker = Striker(rollout, bounds=bounds, limits=keeps, t_stay=t_stay)
    slow = striker.admissible(strikes)
    kept = slow[striker.keep(slow)]
    if not len(kept):
        raise InputError("wiggle", f"none of {len(strikes)} movements within the limits", "one", "give more candidates")
    return kept
