"""Outputs and frequency responses of given parameter vectors: plain arithmetic, nothing proved."""
