"""Training by existing solvers, and to proved global optima."""
