"""Problems as text and as files: what is read in, and what is written out."""
