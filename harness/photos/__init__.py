"""Photos of people without a scan: import, align, reconstruct, export."""
