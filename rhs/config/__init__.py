"""From words to parts: registry, settings, composition."""
