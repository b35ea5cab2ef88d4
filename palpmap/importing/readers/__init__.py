"""Files of strangers into tables: text, spreadsheets, arrays, bags; parsed, never executed."""
