"""Mixed models of what throws come to, by style and block, with people as random effects.

The models and the way they are chosen are those of Krotov et al. 2022: the interaction of style and block, and people
who differ in their responses to style and block, are taken in where the likelihood favours them.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2, norm

from papers.human.reading import Throws
from whiptool.extras import optional

ALPHA = 0.05
FIRST_BLOCK, DISCRETE = 1, "discrete"
_START = 0.1  # variance between people over that of all throws


@dataclass(frozen=True)
class Effect:
    """A fixed effect with its 95 % interval.

    Args:
        name: `mean` (discrete style, first block), `style` (rhythmic less discrete), `block` (a block later), or
            `style x block`.
        value, low, high: In the quantity's unit; of hits in log odds.
        p: Of its being zero.
    """

    name: str
    value: float
    low: float
    high: float
    p: float


@dataclass(frozen=True)
class MixedModel:
    """One quantity's model.

    Args:
        quantity: A column of the table of throws.
        effects: Fixed effects.
        random: What people differ in: of `mean`, `style`, `block`.
        between: Standard deviation between people of each of those.
        within: Standard deviation of throws about their person's line.
        log_likelihood: Log likelihood of the fit by maximum likelihood.
        throws: Number of throws.
    """

    quantity: str
    effects: tuple[Effect, ...]
    random: tuple[str, ...]
    between: tuple[float, ...]
    within: float
    log_likelihood: float
    throws: int

    def effect(self, name: str) -> Effect | None:
        """Return a fixed effect, or None where the model has none of that name."""
        return next((one for one in self.effects if one.name == name), None)


def fit_mixed(throws: Throws, quantity: str, *, interaction: bool, random: Sequence[str] = ("mean",)) -> MixedModel:
    """Return a linear mixed model of a quantity by maximum likelihood.

    Args:
        throws: Table, see `papers.human.reading.People`; throws without the quantity are left out.
        quantity: Its column.
        interaction: Whether blocks may do something else in the other style.
        random: What people differ in: `mean`, and of `style` and `block`.

    Raises:
        InputError: statsmodels is not installed.
    """
    known = throws[throws[quantity].notna()]
    columns = _columns(known, interaction=interaction)
    y = known[quantity].to_numpy(float)
    scale = float(y.std()) or 1.0
    X, Z = (np.column_stack([columns[name] for name in names]) for names in (columns, random))
    api = optional("statsmodels.api", "mixed models")
    model = api.MixedLM(y / scale, X, groups=known["person"].to_numpy(), exog_re=Z)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a variance between people may end at its bound, zero
        found = model.fit(reml=False, method=["lbfgs", "powell"], start_params=_start(y / scale, X, Z.shape[1]))
    k = X.shape[1]
    squares = np.diag(np.asarray(found.cov_params()))[:k]
    errors = scale * np.sqrt(np.where(squares > 0, squares, np.nan))
    variances = np.diag(np.atleast_2d(np.asarray(found.cov_re)))
    return MixedModel(
        quantity=quantity,
        effects=_effects(list(columns), scale * np.asarray(found.fe_params), errors),
        random=tuple(random),
        between=tuple((scale * np.sqrt(np.maximum(variances, 0))).tolist()),
        within=scale * float(np.sqrt(found.scale)),
        log_likelihood=float(found.llf) - len(y) * float(np.log(scale)),
        throws=len(y),
    )


def _start(y: np.ndarray, X: np.ndarray, random: int) -> Any:
    """Return where the likelihood is climbed from: from its own start statsmodels may run to infinite variances."""
    from statsmodels.regression import mixed_linear_model

    parameters: Any = mixed_linear_model.MixedLMParams

    fixed = np.linalg.lstsq(X, y, rcond=None)[0]
    return parameters.from_components(fe_params=fixed, cov_re=_START * np.eye(random))


def chosen_mixed(throws: Throws, quantity: str) -> MixedModel:
    """Return the model that likelihood ratios choose, term by term.

    First the interaction of style and block, then how people differ: in one of style and block, then in both.
    """
    best = fit_mixed(throws, quantity, interaction=False)
    wider = fit_mixed(throws, quantity, interaction=True)
    interaction = _is_better(wider, best, 1)
    best = wider if interaction else best
    one_more = [fit_mixed(throws, quantity, interaction=interaction, random=("mean", x)) for x in ("style", "block")]
    better = [one for one in one_more if _is_better(one, best, 2)]
    if not better:
        return best
    best = max(better, key=lambda one: one.log_likelihood)
    both = fit_mixed(throws, quantity, interaction=interaction, random=("mean", "style", "block"))
    return both if _is_better(both, best, 3) else best


def fit_hits(throws: Throws) -> tuple[Effect, ...]:
    """Return the effects of style and block on the log odds of a hit, by generalised estimating equations.

    Throws of one person are correlated alike; the errors are robust against another correlation (Liang and Zeger 1986).

    Raises:
        InputError: statsmodels is not installed.
    """
    api = optional("statsmodels.api", "mixed models")
    columns = _columns(throws, interaction=False)
    model = api.GEE(
        throws["hit"].to_numpy(float),
        np.column_stack(list(columns.values())),
        groups=throws["person"].to_numpy(),
        family=api.families.Binomial(),
        cov_struct=api.cov_struct.Exchangeable(),
    )
    found = model.fit()
    return _effects(list(columns), np.asarray(found.params), np.asarray(found.bse))


def _columns(throws: Throws, *, interaction: bool) -> dict[str, np.ndarray]:
    style = (throws["style"] != DISCRETE).to_numpy(float)
    block = throws["block"].to_numpy(float) - FIRST_BLOCK
    columns = {"mean": np.ones(len(throws)), "style": style, "block": block}
    return columns | {"style x block": style * block} if interaction else columns


def _effects(names: Sequence[str], values: np.ndarray, errors: np.ndarray) -> tuple[Effect, ...]:
    z = float(norm.ppf(1 - ALPHA / 2))
    p = 2 * norm.sf(np.abs(values / errors))
    rows = np.column_stack([values, values - z * errors, values + z * errors, p]).tolist()
    return tuple(Effect(name, *row) for name, row in zip(names, rows, strict=True))


def _is_better(wider: MixedModel, narrower: MixedModel, more: int) -> bool:
    ratio = 2 * (wider.log_likelihood - narrower.log_likelihood)
    return bool(chi2.sf(max(ratio, 0.0), more) < ALPHA)
