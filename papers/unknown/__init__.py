"""Unknown whips and ropes: struck, learned and struck again, in the plane (`whips_report`) and in space."""
