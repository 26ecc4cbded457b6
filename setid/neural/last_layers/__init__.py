"""One-step errors and last layers: what a record says of a network that is fed by readings."""
