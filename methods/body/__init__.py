"""The body prior: parametric bodies, what is detected of them in photos, and their joint fit."""
