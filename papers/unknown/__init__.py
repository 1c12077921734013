"""Whips and ropes that nobody knows: struck, learned and struck again, in the plane (`whips_report`) and in space."""
