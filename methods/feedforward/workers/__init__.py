"""One folder for each network: ``method.toml``, and the one file that runs beside it."""
