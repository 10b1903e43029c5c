"""The run matrix: plan, worker processes, records, cost."""
