"""A new impedance law: constant impedance that hardens with the position error."""

from dataclasses import dataclass, field

import numpy as np

import whiptool as wt


@dataclass(frozen=True)
class HardeningImpedance:
    """`tau = (1 + c |e|^2) (K e + B de)`.

    Args:
        c: How fast it hardens [1/rad^2].
        base: K and B.
    """

    c: float = 100.0
    base: wt.ConstantImpedance = field(default_factory=wt.ConstantImpedance)

    kind = "hardening"

    def gains(self, e: np.ndarray, de: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """K [N m/rad] and B [N m s/rad] for errors `e` [rad] and `de` [rad/s], (..., n): each (..., n, n)."""
        scale = (1 + self.c * np.vecdot(e, e))[..., None, None]
        K, B = self.base.gains(e, de)
        return scale * K, scale * B

    def parameters(self) -> dict[str, np.ndarray]:
        """The law's numbers by name."""
        return {"c": np.array([self.c]), **self.base.parameters()}


def largest_errors(law: object, strike: wt.Strike) -> np.ndarray:
    """Largest position errors of shoulder and elbow over a strike in MuJoCo [rad], (2,)."""
    rollout = wt.ReferenceRollout(wt.preset("lemon2024"), wt.Controller(law))
    path = rollout.trajectory(strike, t_stay=0.3)
    return np.abs(path.q_d - path.q[:, :2]).max(axis=0)


if __name__ == "__main__":
    strike = wt.Strike(q_i=(-1.36, 0.47), q_f=(1.73, 1.41), D=0.95)
    constant = largest_errors(wt.ConstantImpedance(), strike)
    soft, hard = (largest_errors(HardeningImpedance(c), strike) for c in (0.0, 100.0))
    assert np.allclose(soft, constant, rtol=1e-9)  # c = 0 is the constant law
    assert (hard < constant).all()
    print("largest errors [rad]: constant", constant.round(3), "hardening", hard.round(3))
