"""``harness data add``: a folder of scans or captures becomes a checked dataset of the manifest."""
