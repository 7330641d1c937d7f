"""The search for a plan that branches at a position fix (``branch.leaves``)."""
