"""Learning an unknown whip strike by strike: strike, film, identify again, plan again."""
