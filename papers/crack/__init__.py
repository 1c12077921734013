"""Wave and crack: a loop that runs along a tapered whip, closed forms, what is reached, and how far to trust it.

`python -m whiptool.reproduce crack`. After Goriely and McMillen 2002 (Phys. Rev. Lett. 88, 244301), Krehl et al. 1998,
and Calkin and March 1989 (Am. J. Phys. 57, 154).
"""

from papers.crack.report import CONTROLLER, MODEL, SUBTITLE, TITLE, facts, sections

__all__ = ["CONTROLLER", "MODEL", "SUBTITLE", "TITLE", "facts", "sections"]
