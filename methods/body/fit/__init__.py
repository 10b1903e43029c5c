"""Fitting one body to N calibrated views: costs, priors and optimisation."""
