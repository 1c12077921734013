"""People and machines that strike with a whip: Krotov, Russo, Nah, Hogan and Sternad 2022 (doi:10.1098/rsos.220581).

The data are theirs and the user's copy is read: nothing of it is part of whiptool.
"""

from whiptool.lazy_names import imported_when_used

_HOMES = {
    "STYLES": "reading",
    "People": "reading",
    "read_people": "reading",
    "PUBLISHED": "findings",
    "all_styles": "findings",
    "agrees": "findings",
    "correlations": "findings",
    "chosen_mixed": "mixed_models",
    "fit_mixed": "mixed_models",
    "fit_hits": "mixed_models",
    "Bullwhip": "bullwhip",
    "cascades": "bullwhip",
    "measured": "cascade_fit",
    "fit_cascade": "cascade_fit",
    "predicted": "cascade_fit",
    "tolerance": "tolerance_costs",
    "costs": "tolerance_costs",
    "machine": "machine_strikes",
    "target_of": "machine_strikes",
    "found_by": "machine_strikes",
    "curve": "machine_strikes",
    "people_misses": "machine_strikes",
    "hit_radius": "machine_sections",
    "blocks_picture": "pictures",
    "cascade_picture": "pictures",
    "throw_picture": "pictures",
    "tolerance_picture": "pictures",
    "learning_picture": "pictures",
}
__getattr__, __dir__ = imported_when_used("papers.human", _HOMES)
