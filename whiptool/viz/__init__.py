"""Pictures of strikes: plots, animation, film, the page to scrub through a strike, and reports."""
