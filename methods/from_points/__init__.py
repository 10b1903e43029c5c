"""The methods that make points into a surface, one module for each family of them."""
