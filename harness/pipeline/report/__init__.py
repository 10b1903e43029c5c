"""Tables, figures and pages of a run: records are read here and passed to the reports."""
