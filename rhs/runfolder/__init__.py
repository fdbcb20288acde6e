"""What is left of a run: steps, row, folder; written and read back."""
