"""The parts of a configuration, as a run builds them."""

from rhs.config.parts import build


def build_parts(config, world, folder):
    """Each with its own generator; nothing has moved yet. world: None for a recording."""
    return build(config.parts, seed=config.seed, world=world, folder=folder, features=config.features)
