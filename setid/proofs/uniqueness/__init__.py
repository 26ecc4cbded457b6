"""Parameters that data cannot fix: free ones, unbounded ones, and normalisations that fix them."""
