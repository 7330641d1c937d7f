"""Files of others: maps and winds in the formats that people have."""
