"""Turn a scan into a capture: calibrated photos with a proof that the cameras are exact."""
