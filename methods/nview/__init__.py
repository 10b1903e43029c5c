"""One closed surface moved to the normal maps and the outlines of all views."""
