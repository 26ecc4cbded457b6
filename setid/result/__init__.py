"""Results of identification, and reports on them."""
