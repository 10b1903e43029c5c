"""Parts that a user brings: what kinds there are, and where what was imported is kept."""
