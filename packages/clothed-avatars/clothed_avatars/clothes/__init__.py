"""Garments: what can be worn, how it is cut, and how it is draped."""
