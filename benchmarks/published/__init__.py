"""A benchmark for planners of others: missions, what was known of the wind, and the winds that came."""
