"""Arguments, steps and trees, attained points and rays."""
