"""One table, four ways to write it: LaTeX, Markdown, CSV and JSON."""
