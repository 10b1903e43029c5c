"""Training data and training runs of the open parts."""
