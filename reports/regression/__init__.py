"""A stored baseline of numbers, and which of them moved."""
