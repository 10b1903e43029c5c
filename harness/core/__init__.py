"""Values that every room shares; needs numpy and the standard library only."""
