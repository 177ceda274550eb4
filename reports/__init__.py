"""The reports: stored results as a static site that opens from disk."""
