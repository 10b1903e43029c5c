"""Turn a scan into a capture: calibrated photos, and a check that the cameras are exact."""
