"""Robot arms with their own controllers: their drivers, and strikes with them."""
