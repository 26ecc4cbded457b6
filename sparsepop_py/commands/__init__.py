"""Commands of the command line that both packages have."""
