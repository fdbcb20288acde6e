"""First-party localisers of rhs."""
