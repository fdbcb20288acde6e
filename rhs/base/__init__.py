"""Ground floor: errors, provenance, memory, data folders, strict YAML. Imports nothing of rhs."""
