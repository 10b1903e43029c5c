"""Tables, figures and pages of a run: records are read here and handed to the reports."""
