"""Find a first box and relaxations that fit. Hints only: the kernel replays every step."""
