"""What is proved, and how anyone re-checks it without a solver."""
