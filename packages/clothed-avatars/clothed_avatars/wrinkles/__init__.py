"""Wrinkles: a draped garment made finer and relaxed with more length than there is room for."""
