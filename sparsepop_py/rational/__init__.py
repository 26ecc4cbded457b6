"""Problems with ratios: signs of denominators, the polynomial problem, the way back."""
