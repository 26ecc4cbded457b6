"""The MATLAB face: structs, parameters, outputs and files of SparsePOP 3.03."""
