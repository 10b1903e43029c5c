"""The run: matrix, records, resume, regression check, doctor."""
