"""Parameter vectors that are consistent with a record, or nearly: estimates, searches, members."""
