"""The engine of filterbench: models, filters' shared atoms, plan, run, store, metrics.

It knows no estimator and no case by name; import what is needed from its modules (``from suite.metrics import METRICS``).
"""
