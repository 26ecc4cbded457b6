"""Problems, certificates and results as JSON: codecs, versions, files."""
