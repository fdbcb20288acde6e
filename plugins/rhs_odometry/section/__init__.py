"""The thesis's filter inside one section of corridor or tube."""
