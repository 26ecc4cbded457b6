"""Turn one relaxation into one proved bound."""
