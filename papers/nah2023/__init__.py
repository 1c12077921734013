"""Nah et al. 2023: a person's arm in space strikes six targets with a whip; their claims compared with what we find.

`python -m whiptool.reproduce nah2023`. Definitions follow the paper's abstract and the code that its authors published
(github.com/mosesnah-shared/whip-project-targeting), see `docs/nah2023.md`.
"""

from papers.nah2023.report import SUBTITLE, TITLE, facts, sections
from papers.nah2023.units import CONTROLLER
from whiptool.models.presets import NAH2023 as MODEL

__all__ = ["CONTROLLER", "MODEL", "SUBTITLE", "TITLE", "facts", "sections"]
