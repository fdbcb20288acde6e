"""Features, rigid motion, the place database, checks of a view."""
