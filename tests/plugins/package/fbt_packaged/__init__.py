"""A package with an estimator and a case for filterbench."""
