"""Non-identifiability: equivalent vectors, common factors, normalisations."""
