"""Comparison of methods by their trials to the first hit: units of work, their storage, tables and figures."""

from whiptool.comparison.learner_unit import LearnerUnit
from whiptool.comparison.plan import Comparison
from whiptool.comparison.search_unit import SearchUnit
from whiptool.comparison.series import Series, collect
from whiptool.comparison.target_scene import TargetScene
from whiptool.comparison.units import Store

__all__ = ["Comparison", "LearnerUnit", "SearchUnit", "Series", "Store", "TargetScene", "collect"]
