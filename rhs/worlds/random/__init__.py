"""Buildings drawn by chance: `world=random:FAMILY`, one file per kind of building."""
