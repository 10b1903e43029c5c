"""MapAnything, run by the user's own installation of its package."""
