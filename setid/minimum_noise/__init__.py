"""The least noise that explains a record, and the samples that contradict each other."""
