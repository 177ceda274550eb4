"""Kinds of figures about a case, one a file: what they show of its results, their drawings, captions and data."""
