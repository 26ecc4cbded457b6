"""Stored rows as tables and pictures."""
