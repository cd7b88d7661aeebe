"""All that leans on private parts of Hydra, Lightning, Numba and others, with the version that it was tried with."""
