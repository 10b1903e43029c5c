"""Tables as plain values: selection of records, columns, notes."""
