"""What is judged: one table of small functions for each file that a run writes."""
