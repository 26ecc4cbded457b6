"""What a record or a structure leaves open: equivalent vectors, common factors, normalisations."""
