"""Turn records into tables and figures; nothing here computes a metric."""
