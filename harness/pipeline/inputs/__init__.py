"""What a run works on: the workspace, scans and photos on demand, sealed data."""
