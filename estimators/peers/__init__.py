"""Adapters of other libraries' filters, one file a library; they show what that library does, defects included."""
