"""What an identification returns, and what is said of it."""
