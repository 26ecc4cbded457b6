"""Incremental stability: norm conditions, one matrix inequality, decay rates."""
