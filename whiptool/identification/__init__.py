"""From recorded strikes to the parameters of a whip."""
