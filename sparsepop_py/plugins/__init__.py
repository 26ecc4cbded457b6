"""Tables of what can be plugged in, and entries into other packages."""
