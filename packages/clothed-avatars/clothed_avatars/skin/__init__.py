"""Colour and hair of generated people."""
