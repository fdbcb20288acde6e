"""KLT tracks, and the odometries that live on them."""
