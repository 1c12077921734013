"""People's whip throws: the door of `python -m whiptool.human`, and the names that notebooks import."""

import sys

from whiptool.lazy_names import imported_when_used

_HOMES = {
    "main": "commands.human",
    "STYLES": "studies.human.reading",
    "People": "studies.human.reading",
    "read_people": "studies.human.reading",
    "PUBLISHED": "studies.human.findings",
    "all_styles": "studies.human.findings",
    "agrees": "studies.human.findings",
    "correlations": "studies.human.findings",
    "chosen_mixed": "studies.human.mixed_models",
    "fit_mixed": "studies.human.mixed_models",
    "fit_hits": "studies.human.mixed_models",
    "Bullwhip": "studies.human.bullwhip",
    "cascades": "studies.human.bullwhip",
    "measured": "studies.human.cascade_fit",
    "fit_cascade": "studies.human.cascade_fit",
    "predicted": "studies.human.cascade_fit",
    "tolerance": "studies.human.tolerance",
    "costs": "studies.human.tolerance",
    "machine": "studies.human.machine_strikes",
    "target_of": "studies.human.machine_strikes",
    "found_by": "studies.human.machine_strikes",
    "curve": "studies.human.learning",
    "people_misses": "studies.human.learning",
    "hit_radius": "studies.human.machine_sections",
    "blocks_picture": "studies.human.pictures",
    "cascade_picture": "studies.human.pictures",
    "throw_picture": "studies.human.pictures",
    "tolerance_picture": "studies.human.pictures",
    "learning_picture": "studies.human.pictures",
}
__getattr__, __dir__ = imported_when_used("whiptool", _HOMES)

if __name__ == "__main__":
    from whiptool.commands.human import main

    sys.exit(main())
