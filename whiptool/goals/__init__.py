"""Goals of strikes: targets and their hit rule, regions of targets, rules of arrival, criteria."""
