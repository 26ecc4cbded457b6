"""Studies: many problems in one file that survives whatever happens to the program."""
