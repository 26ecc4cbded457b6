"""Models of other software: Pyomo, MPS, LP, QPLIB, and what SCIP reads."""
