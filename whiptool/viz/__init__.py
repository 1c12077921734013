"""Pictures of strikes: plots, animation, film, interactive page, and reports."""
