"""Folders of a user's own scans: what lies in them, and how it becomes a dataset."""
