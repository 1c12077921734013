"""The exit status of a fit: 0 only where its values are a minimum's."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from whiptool.identification.results import Fit


def convergence_status(found: Fit) -> int:
    """Return the exit status of a fit: 1 where it did not converge, which is said on stderr."""
    if found.converged:
        return 0
    said = f"not converged: {found.status.value}: values and intervals may be off"
    print(f"whiptool: {said}; more --starts or a nearer --model may help", file=sys.stderr)
    return 1
