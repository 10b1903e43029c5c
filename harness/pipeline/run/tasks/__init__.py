"""The work of a run as tasks that can travel: a subject's photos, and each of its cells."""
