"""A monocular filter over corridors with corners: pose, walls, widths."""
