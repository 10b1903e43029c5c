"""Who the subjects are: a written list, people that are hard to reconstruct, people drawn by id."""
