"""PIXIE, which regresses SMPL-X from a photo, from the user's own ``pixie_model.tar``."""
