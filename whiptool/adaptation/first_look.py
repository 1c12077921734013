"""Measurement of the whip before the first strike, hanging or in a slow movement, and the deviation of the resting arm.

An impedance law carries weight only with a position error, so that the arm at rest deviates from its command.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from whiptool.adaptation.prior import Belief, fresh_terms
from whiptool.errors import InputError
from whiptool.identification.predict import Predictor
from whiptool.impedance.laws import Law
from whiptool.limits.all_limits import Given
from whiptool.models.strike import T_STAY, Strike, StrikeBounds, default_bounds
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rollout.compiled import CompiledRollout
from whiptool.strike_map.striker import Striker

SWING = 0.7  # [rad] that a joint turns at most
DURATION = (0.4, 0.8)  # [s]
FASTEST = 8.0  # [m/s] of the tip: a strike has it at 10 to 40
CANDIDATES = 32  # random movements or postures that are compared
ROUNDS = 16  # of random movements that are drawn before none is found
Check: TypeAlias = Callable[[Strike], str | None] | None
STILL = 0.5  # [s] that a hanging whip is filmed, and `t_stay` more
WIDEST = 0.35  # [m], largest standard error of the tip's place, to which a linearised prior is used in space
FPS, NOISE = 60.0, 0.005  # [1/s], [m] of the camera that is expected


def information(
    belief: Belief, strikes: np.ndarray, *, t_stay: float = T_STAY
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return for each strike (B, 2 a + 1) the information gain of recording it [nat], the largest speed of the tip
    between two frames [m/s], and the largest standard error of the predicted tip in any frame [m], (B,) each.

    The belief is linearised around its mean; the gain is half the logarithm of the ratio of the determinants of prior
    and posterior covariance.
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


def hanging(
    belief: Belief,
    bounds: StrikeBounds | None = None,
    *,
    rng: np.random.Generator,
    t_stay: float = T_STAY,
    keeps: Given = (),
    check: Check = None,
) -> Strike:
    """Return a strike without movement, during which the length of the hanging whip can be measured: in the middle of
    the start postures or, if it breaks a limit there, in the nearest of random start postures that keep the limits.

    The limits `keeps` are judged with the mean of the belief; `check`, asked after them, returns why a strike must not
    be made, or None.
    """
    lower, upper = (bounds or default_bounds(belief.plant.model.arm)).box
    a = belief.plant.model.arm.n
    middle, width = (lower[:a] + upper[:a]) / 2, upper[:a] - lower[:a]
    at_rest = lambda q: np.hstack([q, q, np.full((len(q), 1), STILL)])  # noqa: E731
    strikes = at_rest(middle[None])
    if not keeps and check is None:
        return Strike.from_vector(strikes[0])
    striker = _striker(belief, bounds, keeps, t_stay)
    nearest, refused = strikes[0], list[str]()
    for _ in range(ROUNDS):
        kept = strikes[striker.keep(strikes)]
        distance = np.linalg.norm((kept[:, :a] - middle) / width, axis=1)
        for strike in map(Strike.from_vector, kept[distance.argsort()]):
            said = None if check is None else check(strike)
            if said is None:
                return strike
            refused.append(said)
        strikes = at_rest(rng.uniform(lower[:a], upper[:a], (CANDIDATES, a)))
    said = refused[0] if refused else _beyond(striker, nearest)
    raise InputError(
        "still",
        f"none of {1 + (ROUNDS - 1) * CANDIDATES} postures in which the hanging whip could be filmed; of the one "
        f"nearest to the middle of the bounds: {said}",
        "at least one posture within the limits",
        "say where the base stands above the floor, or skip this measurement with still=False",
    )


def _beyond(striker: Striker, vector: np.ndarray) -> str:
    """Return the limit that a strike (m,) exceeds with the mean of the belief."""
    strike = Strike.from_vector(vector)
    path = striker.rollout.trajectory(strike, t_stay=striker.t_stay)
    return striker.limits.explain(path, striker.rollout.model.arm.joints, strike) or "its simulation diverges"


def choose_wiggle(
    belief: Belief,
    *,
    rng: np.random.Generator,
    bounds: StrikeBounds | None = None,
    t_stay: float = T_STAY,
    candidates: int = CANDIDATES,
    keeps: Given = (),
    check: Check = None,
) -> tuple[Strike, float]:
    """Return the random short movement with a slow tip that has the largest `information` gain, and this gain [nat].

    In space, the linearised prior overestimates the gain of movements whose outcome is hardly predictable; such
    movements are left out if others remain. While none of the `candidates` keeps the limits with a slow tip, as many
    are drawn again, up to `ROUNDS` times.
    """
    lower, upper = (bounds or default_bounds(belief.plant.model.arm)).box
    a = belief.plant.model.arm.n
    reach = np.minimum(lower[:a], lower[a:-1]), np.maximum(upper[:a], upper[a:-1])
    striker = _striker(belief, bounds, keeps, t_stay) if keeps else None
    slowest, said = np.inf, None
    for _ in range(ROUNDS):
        q_i = rng.uniform(lower[:a], upper[:a], (candidates, a))
        q_f = np.clip(q_i + rng.uniform(-SWING, SWING, q_i.shape), *reach)
        strikes = np.hstack([q_i, q_f, rng.uniform(*DURATION, (candidates, 1))])
        if striker is not None:
            strikes = striker.admissible(strikes)
            strikes = strikes[striker.keep(strikes)]
        if not len(strikes):
            continue
        gain, fastest, widest = information(belief, strikes, t_stay=t_stay)
        gain = np.where(fastest <= FASTEST, gain, -np.inf)
        foreseen = gain if belief.plant.model.dimension == 2 else np.where(widest <= WIDEST, gain, -np.inf)
        gain = foreseen if np.isfinite(foreseen).any() else gain
        for best in np.argsort(-gain)[: np.isfinite(gain).sum()]:
            strike = Strike.from_vector(strikes[best])
            refused = None if check is None else check(strike)
            if refused is None:
                return strike, float(gain[best])
            said = said or refused
        slowest = min(slowest, fastest.min(where=fastest > FASTEST, initial=np.inf))
    if said is not None:
        raise InputError("wiggle", "no movement that may be made", "at least one", f"the best of them: {said}")
    if np.isfinite(slowest):
        given = f"movements in which the tip reaches {slowest:.1f} m/s or more"
        raise InputError("wiggle", given, f"at most {FASTEST:g} m/s", "leave it out")
    raise InputError(
        "wiggle",
        f"none of {ROUNDS * candidates} movements within the limits",
        "at least one",
        "give wider limits, or leave it out",
    )


def _striker(belief: Belief, bounds: StrikeBounds | None, keeps: Given, t_stay: float) -> Striker:
    """Return the judge of movements by the mean of the belief."""
    plant = belief.at()
    assert plant.controller is not None
    rollout = CompiledRollout(plant.model, plant.controller, free=fresh_terms(belief))
    return Striker(rollout, bounds=bounds, limits=keeps, t_stay=t_stay)


Sag = Callable[[np.ndarray], np.ndarray]  # from postures q_i (B, a) to how far off the arm stands (B, a) [rad]
_RIDGE = 0.03  # of a posture's sines, below which it tells nothing of a link's weight
_FIRST, _ROUNDS, _DIFFERENCE, _LARGEST = 0.1, 60, 1e-6, 0.2  # [rad]


def expected_sag(law: Law, recordings: Sequence[StrikeRecording | None]) -> Sag | None:
    """Return a function that predicts from earlier recordings how far the arm at rest deviates (B, a) [rad] from
    commanded postures q_i (B, a); None if no joints were measured, or no joint deviated.

    The uncompensated gravity torque of link j and the links after it is `c_j sin(theta_j)` at the joints up to j, with
    theta_j the link's angle to the vertical. The measured errors at rest give the controller's torques, these give c by
    least squares, and c predicts the errors at other postures.
    """
    rows, torques = [], []
    for recording in recordings:
        sag = None if recording is None else recording.sag
        if sag is None:
            continue
        assert recording is not None
        assert recording.strike is not None
        rows.append(_levers(np.array([recording.strike.q_i]) + sag)[0])
        torques.append(_held(law, -sag[None])[0])
    if not rows or not np.any(torques):
        return None
    M, tau = np.vstack(rows), np.concatenate(torques)
    left = np.linalg.solve(M.T @ M + _RIDGE**2 * np.eye(M.shape[1]), M.T @ tau)

    def stands(q_i: np.ndarray) -> np.ndarray:
        first = _errors(law, _levers(q_i) @ left)
        return -_errors(law, _levers(q_i - first) @ left)

    return stands


def _levers(q: np.ndarray) -> np.ndarray:
    """Torque of every joint by the unbalanced moment of every link, (B, a, a)."""
    return np.triu(np.ones((q.shape[1],) * 2)) * np.sin(np.cumsum(q, axis=1))[:, None, :]


def _held(law: Law, e: np.ndarray) -> np.ndarray:
    """The law's torques at rest for errors e (B, a) [N m]."""
    return np.einsum("bij,bj->bi", law.gains(e, np.zeros_like(e))[0], e)


def _errors(law: Law, torque: np.ndarray) -> np.ndarray:
    """The errors at which the law holds torques (B, a) at rest, by Newton's method from beyond; at most `_LARGEST`."""
    size = np.linalg.norm(torque, axis=1, keepdims=True)
    e = _FIRST * torque / np.maximum(size, 1e-12)
    a = e.shape[1]
    for _ in range(_ROUNDS):
        steps = _DIFFERENCE * np.eye(a)
        slopes = [(_held(law, e + step) - _held(law, e - step)) / (2 * _DIFFERENCE) for step in steps]
        J = np.stack(slopes, axis=2) + 1e-9 * np.eye(a)
        move = np.linalg.solve(J, (torque - _held(law, e))[..., None])[..., 0]
        e = np.clip(e + move, -_LARGEST, _LARGEST)
        if np.abs(move).max(initial=0.0) < 1e-7:
            break
    return np.where(size > 1e-9, e, 0.0)
