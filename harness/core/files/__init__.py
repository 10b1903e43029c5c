"""Atomic writing, the rule for names, and hashes of files and values."""
