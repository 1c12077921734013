"""Trials to hit, method by method: the units of work, how they are kept, and what they say."""

from whiptool.studies.comparison.learner_unit import LearnerUnit
from whiptool.studies.comparison.plan import Comparison
from whiptool.studies.comparison.scene import Scene
from whiptool.studies.comparison.search_unit import SearchUnit
from whiptool.studies.comparison.series import Series, collect
from whiptool.studies.comparison.store import Store

__all__ = ["Comparison", "LearnerUnit", "Scene", "SearchUnit", "Series", "Store", "collect"]
