"""Runs: plan, cells, workers, records, stores, executors."""
