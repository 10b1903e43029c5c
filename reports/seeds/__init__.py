"""Results under several seeds, side by side."""
