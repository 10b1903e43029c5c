"""The built-in methods that make points into a surface, a module for each."""
