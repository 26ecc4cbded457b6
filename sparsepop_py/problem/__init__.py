"""The problem that is stated, and one numbering of all that multipliers multiply."""
