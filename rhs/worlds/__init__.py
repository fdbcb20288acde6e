"""World files and their checks, maps, MovingAI, tubes."""
