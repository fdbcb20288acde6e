"""Why does it fail? Truth is put in the place of one link after another, and the loss is shared out."""
