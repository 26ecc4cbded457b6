"""Records of inputs and outputs, how they are read, and the noise in them."""
