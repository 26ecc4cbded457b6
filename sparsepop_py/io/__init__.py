"""Read and write problems, certificates and results: GAMS, text, JSON, SDPA."""
