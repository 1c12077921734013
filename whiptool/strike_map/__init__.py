"""Strike maps, which return a strike for any goal of a region without a search."""

from whiptool.goals.arrival_rule import GoalRegion
from whiptool.strike_map.answers import Answers
from whiptool.strike_map.building import Building, MapPlan
from whiptool.strike_map.strike_map import StrikeMap
from whiptool.strike_map.striker import Striker

__all__ = ["Answers", "Building", "GoalRegion", "MapPlan", "StrikeMap", "Striker"]
