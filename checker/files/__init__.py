"""Problems as JSON, as text and as .gms."""
