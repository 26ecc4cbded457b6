"""One measurement: what is run, watched, judged and written."""
