"""First-party mappers of rhs."""
