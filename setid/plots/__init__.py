"""Pictures of records and results; the one door of setid to matplotlib."""
