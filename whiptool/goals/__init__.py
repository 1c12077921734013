"""What a strike is to do: targets and their hit rule, regions of targets, rules of arrival, criteria."""
